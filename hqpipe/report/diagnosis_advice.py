"""What each effect is, in half a sentence, and what an engineer can do about it, in one."""

from __future__ import annotations

MEANINGS = {
    "command_delay": "the command acts later than it was given",
    "valve_delay": "the valve acts later than the controller asks it to",
    "valve_lag": "the valve's spool follows its command with a lag",
    "valve_deadband": "commands smaller than the valve's overlap do nothing",
    "flow_saturation": "beyond a certain command the valve is fully open",
    "orifice_flow": "flow falls with the square root of the pressure that the load leaves over",
    "supply_droop": "the supply pressure sags when all joints together draw much oil",
    "direction_asymmetry": "extending and retracting have different gains: unequal areas or an unmeasured constant load",
    "dead_time_asymmetry": "one direction takes longer than the other to answer a command",
    "opening_jump": "at the edge of the deadband the flow sets in at once with a share of its full size",
    "leakage": "oil leaks past piston or spool, so that the joint creeps while its valve is closed",
    "counterbalance": "a load-holding valve keeps a pulling load from speeding the motion up",
    "one_way_speed_limit": "one direction does not exceed a certain speed, whatever the command",
    "position_dependent_stiffness": "the gain changes with the position, as the oil volumes do",
    "gain_drift": "the gain changes in the course of a trial, as with warming oil",
    "leakage_drift": "leakage changes in the course of a trial, as oil gets thinner with its temperature",
    "integral_action": "the controller on the machine integrates its error",
    "coulomb_friction": "dry friction opposes every motion",
    "stribeck_friction": "friction is larger near zero speed",
    "viscous_friction": "friction grows with speed",
    "load_dependent_friction": "friction grows with the torque that is transmitted",
    "backlash": "motion is lost at each reversal",
    "transmission_compliance": "chain, hose or gear stretch under load",
    "armature": "the drive's own inertia, seen at the joint",
    "payload": "a link carries mass that the model does not know",
    "inertia_error": "a link's inertia differs from the model's",
    "com_error": "a link's centre of mass differs from the model's",
    "ground_friction": "the feet slip at another friction coefficient",
    "ground_compliance": "the ground yields",
    "ground_slope": "the ground is not level",
    "torque_bias": "the torque reading has an offset",
    "torque_scale": "the torque reading is off by a factor",
    "position_bias": "the joint's zero is off",
    "channel_skew": "torque is logged later than position",
    "unsigned_sensor": "a channel lost its sign",
    "voltage_sag": "the supply voltage gives way under load, so that the drive has less to give",
    "torque_limit": "beyond a certain torque the drive gives no more",
    "gain_error": "the gain of the drive is not what is stated",
    "spring": "a spring, or what acts like one, pulls the joint to a place",
    "mount_tilt": "the base is not level, so that gravity pulls in another direction",
    "gain_change": "the same command opens the valve for more or less oil than it did",
    "leakage_change": "more or less oil leaks away than did",
    "velocity_coupling_change": "motion takes more or less torque away than it did",
    "impact_change": "impacts against the command are braked differently",
    "stiffness_change": "the oil and what encloses it have become stiffer or softer",
}

ADVICE = {
    "command_delay": "Look for the delay on the bus and in the control loop and remove what you can; give the rest to "
    "the simulator, and vary it a little in training.",
    "valve_delay": "Look for the delay between the controller and the spool (valve driver, its bus, the pilot stage); it "
    "lies inside the position loop, so it limits the gain. Give the rest to the simulator.",
    "valve_lag": "Train with the lag, and keep the policy's commands below the spool's bandwidth; dither or a higher "
    "pilot pressure makes the spool faster.",
    "valve_deadband": "Compensate the lap in the valve driver: step across ± the half width when the command changes "
    "sign, blended so that it does not chatter; then record again.",
    "flow_saturation": "Do not ask for more speed than the open valve gives: limit the command, lower the gain or fit "
    "a larger valve; train with the limit.",
    "orifice_flow": "Use the square-root law in the simulator; with measured pressures the valve driver can divide the "
    "command by the same root.",
    "supply_droop": "Check the accumulator's precharge and the pump's flow limit, log the supply pressure, and train "
    "with the droop that all joints share.",
    "direction_asymmetry": "Give each direction its own gain in the valve driver, the two piston areas differ; the "
    "ratio should then come out as zero.",
    "dead_time_asymmetry": "Look at the pilot stages and hoses of both directions; give each direction its own dead "
    "time in the simulator.",
    "opening_jump": "Lower the driver's deadband compensation until the motion sets in gently, or keep the jump in the "
    "simulator: without it the policy will hunt round standstill.",
    "leakage": "Hold the joint under load with its valve closed and watch it sink: look at piston seals, spool and "
    "load-holding valves, and keep the creep in the simulator.",
    "counterbalance": "Keep the load out of the lowering speed in the simulator; a counterbalance, overcentre or "
    "load-holding valve does this on the machine.",
    "one_way_speed_limit": "Look for a counterbalance valve, a throttle with a check valve or a lowering brake in this "
    "direction, and put the limit in the simulator.",
    "position_dependent_stiffness": "Schedule the gain with the position, or keep the slope in the simulator so that "
    "the policy learns it.",
    "leakage_drift": "Warm the oil up before recording and log its temperature; a rate far beyond what the viscosity of the "
    "oil does per kelvin points at seals. Vary the leakage over this range in training.",
    "gain_drift": "Warm the oil up before recording and log its temperature; vary the gain over this range in "
    "training.",
    "integral_action": "Read ki and the anti-windup from the controller's settings and put them in the simulator, or "
    "switch the integrator off.",
    "coulomb_friction": "Simulate it, and feed it forward with the sign of the wanted speed; if it has grown, look at "
    "seals, bearings and chain tension.",
    "stribeck_friction": "Avoid creeping below the speed found here, or add dither; without it in the simulator the "
    "policy will stick and slip on the machine.",
    "viscous_friction": "Set the joint's damping in the simulator to this value, and vary it with the oil temperature "
    "that you expect.",
    "load_dependent_friction": "Let friction grow with torque in the simulator; look at lubrication and alignment of "
    "gear or chain.",
    "backlash": "Take up the slack, by chain tension or preload; simulate what stays as a dead zone between drive and "
    "joint.",
    "transmission_compliance": "Stiffen hose, chain or mount, or simulate the spring; measure the position on the "
    "joint's side of it.",
    "armature": "Enter it as the joint's armature in the simulator; the link inertias of the URDF do not hold it.",
    "payload": "Weigh what the link carries and enter it in the URDF; if it changes from run to run, vary it in "
    "training.",
    "inertia_error": "Correct the link in the URDF, from CAD or from a pendulum test of the dismounted link.",
    "com_error": "Correct the link's centre of mass in the URDF: hang the link from two points, or hold it still at "
    "several angles.",
    "ground_friction": "Measure how much the foot resists pulling on this ground, and vary the coefficient round it in "
    "training.",
    "ground_compliance": "Simulate the ground with this stiffness, or record on a hard floor to judge the actuators "
    "alone.",
    "ground_slope": "Level the floor or the inertial sensor before recording, or give the slope to the simulator.",
    "torque_bias": "Zero the sensor at rest and without load before each session, then record again.",
    "torque_scale": "Calibrate the sensor with a known weight on a known lever.",
    "position_bias": "Redo the joint's zero against a jig or an end stop.",
    "channel_skew": "Stamp both channels at their source, or shift the later one by this much before the fit: it is an "
    "error of the log, not of the machine.",
    "voltage_sag": "Log the supply voltage, use thicker leads or a stronger supply, and put the resistance in the "
    "simulator.",
    "torque_limit": "Put the limit in the simulator, and keep the commanded motion below it; look at the drive's current "
    "limit and supply.",
    "gain_error": "Read the gain from the drive's settings and state it in logset.yaml; use the one found here in the "
    "simulator.",
    "spring": "Look for a counterweight, gas spring or cable that pulls, and put it in the simulator as a joint stiffness.",
    "mount_tilt": "Level the base, or give its angle to the simulator.",
    "gain_change": "Look at the supply pressure first, then at the valve driver's gain and the valve's edges; train "
    "with the model of now.",
    "leakage_change": "Hold the joint under load and watch it sink: piston seals and the valve's lands leak with wear, "
    "and more so in hot oil; plan the repair, and train with the model of now.",
    "velocity_coupling_change": "Check the scales of encoder and torque sensor first, for area times stiffness does not "
    "wear; then the volume of oil between valve and cylinder.",
    "impact_change": "Look at relief and anti-cavitation valves; the coefficient acts only while an impact drives the "
    "torque against the command.",
    "stiffness_change": "Bleed the air, and look at the oil's temperature, the hoses and their length; train with the "
    "model of now.",
    "unsigned_sensor": "Log the signed quantity, such as the difference of two pressures or the signed current; "
    "no model can be fitted without the sign.",
}
NO_ADVICE = "Retrain with the model that holds this effect, and record again to see what is left."
