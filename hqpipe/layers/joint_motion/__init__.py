"""The layer of torque and motion: inverse dynamics of each joint without a robot description."""

from hqpipe.layers.joint_motion.joint_motion import JointMotion

__all__ = ["JointMotion"]
