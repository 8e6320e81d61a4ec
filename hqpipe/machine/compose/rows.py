"""Source of the loop that steps the joints of one robot, sample by sample."""

from __future__ import annotations

from hqpipe.machine.compose.source import Source, Straight, call, constants, present, scalar, started
from hqpipe.machine.compose.wiring import STATE, Call, Chain, Link, Ref

SAMPLES, WOUND, FIRST = 0, 1, 2  # columns of the memory: samples so far, torque of the base, states of the links
JOINT = "p, m, torque, raw_command, raw_position, velocity, demand"
INPUT_LINES = ("command, position, sliding = raw_command, raw_position, velocity",)


class Memory:
    """Where the states and the past of delayed signals stand in the memory of a joint."""

    def __init__(self, chain: Chain) -> None:
        links = [
            x for x in (*chain.late, *chain.ahead, *chain.core, *chain.behind) if not x.logged and not x.of_the_log
        ]
        names = [out.name for link in links for out in link.outs if out.kind == STATE]
        self.of = {name: FIRST + i for i, name in enumerate(dict.fromkeys(names))}
        self.delays: list[Link] = [link for link in links if link.call is None]
        self.rings = {link.name: f"{FIRST + len(self.of)} + {i} * RING" for i, link in enumerate(self.delays)}

    @property
    def columns(self) -> str:
        """How many there are, as an expression."""
        return f"{FIRST + len(self.of)} + {len(self.delays)} * RING"

    def text(self, ref: Ref) -> str:
        """A name in straight-line code with this memory."""
        return f"m[{self.of[ref.name]}]" if ref.kind == STATE else scalar(ref)


def write_rows(source: Source, chain: Chain) -> None:
    """`begin`, which fills the memory of a joint at its first sample, `step_joint` and `step_row`."""
    memory = Memory(chain)
    _begin(source, chain, memory)
    _joint(source, chain, memory)
    with source.function("step_row", "parameters, tau, memory, q_des, q, qd", "Joints of one robot, in place."):
        speed, opening = (chain.column("setting", name) for name in ("flow_per_speed", "flow_per_opening"))
        source.add("demand = 0.0")
        with source.under("for j in range(tau.shape[0]):"):
            source.add(
                f"demand += parameters[j, {speed}] * abs(qd[j]) + parameters[j, {opening}] * abs(q_des[j] - q[j])"
            )
        with source.under("for j in range(tau.shape[0]):"):
            source.add("tau[j] = step_joint(parameters[j], memory[j], tau[j], q_des[j], q[j], qd[j], demand)")


def _inputs(source: Source, chain: Chain, memory: Memory) -> Straight:
    source.add(f"dt = p[{chain.column('setting', 'sample_time')}]", f"time = m[{SAMPLES}] * dt", *INPUT_LINES)
    constants(source, chain)
    known = ("raw_command", "raw_position", "command", "position", "velocity", "sliding", "time", "demand")
    return Straight(source, chain, known, memory.text)


def _begin(source: Source, chain: Chain, memory: Memory) -> None:
    with source.function("begin", JOINT, "Memory of a joint at its first sample, as if it had been held there."):
        code = _inputs(source, chain, memory)
        source.add(*(f"m[{column}] = 0.0" for column in memory.of.values()))
        found = False
        for link in (*chain.late, *chain.ahead):
            if link.logged:
                continue
            if link.balance:
                code.started(chain.core)
                _found(source, chain, code)
                found = True
            _started(source, chain, memory, code, link)
        code.started(chain.core)
        if not found:
            _found(source, chain, code)
        source.add(f"m[{WOUND}] = wound")


def _started(source: Source, chain: Chain, memory: Memory, code: Straight, link: Link) -> None:
    """The state of a link at the first sample, and its output."""
    if link.call is None:
        name = link.outs[0].name
        code.need([name])
        with source.under("for i in range(RING):"):
            source.add(f"m[{memory.rings[link.name]} + i] = {name}")
        return
    code.needs_of(link.call)
    for name, start in link.starts.items():
        place = f"m[{memory.of[name]}]"
        if isinstance(start, tuple):
            with source.under(f"if {present(link.when)}:"):
                _balanced(source, chain, code, place, start[0])
        else:
            if isinstance(start, Call):
                code.needs_of(start)
            source.add(f"{place} = {started(source, start, code.text)}")
    source.add(*(f"first_{name} = m[{memory.of[name]}]" for name in link.starts))
    code.link(link)  # its output at the first sample, without the step of its states
    source.add(*(f"m[{memory.of[name]}] = first_{name}" for name in link.starts))


def _found(source: Source, chain: Chain, code: Straight) -> None:
    """The torque of the base behind which the present one lies."""
    code.need(["turned", "slow"])
    source.add("behind = torque")
    code.unloaded()
    source.add("expected = 1e300 * np.sign(behind)", "effort = inner")
    code.known |= {"wound", "effort"}
    code.rewound()


def _balanced(source: Source, chain: Chain, code: Straight, place: str, limit: Call) -> None:
    """A state that the opening of the first sample lacks to hold the torque."""
    inner = Straight(source, chain, code.known, code.text)
    inner.needs_of(chain.needed)
    source.add("asked = opening", f"needed = {call(source, chain.needed, code.text)}", "opening = needed")
    inner.need(["passed"])
    for link in chain.core:
        inner.link(link)
    source.add(
        f"most = {call(source, limit, code.text)}",
        "opening = asked",
        f"{place} = min(max(needed / max(p[{chain.gain}] * passed, 1e-300) - opening, -most), most)",
    )


def _joint(source: Source, chain: Chain, memory: Memory) -> None:
    with source.function("step_joint", JOINT, "Torque of one joint after one sample, N·m."):
        source.add(f"now = int(m[{SAMPLES}])")
        with source.under("if now == 0:"):
            source.add(f"begin({JOINT})")
        code = _inputs(source, chain, memory)
        for link in (*chain.late, *chain.ahead):
            if link.logged:
                continue
            if link.call is None:
                name, ring = link.outs[0].name, memory.rings[link.name]
                code.need([name])
                with source.under(f"if {present(link.when)}:"):
                    source.add(f"m[{ring} + now % RING] = {name}", f"{name} = past(m, {ring}, now, p[{link.by}] / dt)")
            else:
                code.link(link)
        source.add(f"wound = m[{WOUND}]", "before = wound")
        code.known |= {"wound", "before"}
        code.behind({"inner"}, False)
        code.behind({"lost"}, False)
        code.behind({"effort"}, False)
        for link in chain.core:
            code.link(link)
        code.law("wound")
        source.add(f"m[{WOUND}] = wound", f"m[{SAMPLES}] = now + 1.0")
        code.behind({"inner", "grip", "turned", "lost", "effort"}, False)
        source.add("measured = effort - lost")
        code.known.add("measured")
        code.behind({"measured"}, False)
        source.add(f"limit = p[{chain.column('setting', 'effort_limit')}]", "return min(max(measured, -limit), limit)")
