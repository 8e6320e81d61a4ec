"""The blocks of a base model and its effects, wired by the names of their signals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from hqpipe.machine.effect import Balanced, Base, Block, Constants, Delay, Effect, Law, State
from hqpipe.machine.moment_arm import MOMENT_ARM, PARAMETERS
from hqpipe.machine.signals import BEHIND, FEEDBACK, INPUTS, NEUTRAL

SETTING = {
    "sample_time": 1e-3,
    "middle": 0.0,
    "clear": 1.0,
    "effort_limit": np.inf,
    "flow_per_speed": 1.0,
    "flow_per_opening": 0.0,
    "speed_late": 0.0,
    "held": -1.0,
    **dict.fromkeys(PARAMETERS, 0.0),
}
"""What a row was made for, beside its law and effects, and each in a row without any: sample time (s), middle position (rad),
torque that must come through a tight chain and largest torque (N·m), what speed and position error count in the flow from the
supply, by how many samples the speed of the friction is late, for how long the joint had been held before a trial began (s;
negative where that is not known), and how the moment arm changes with the position."""
ALIASES = {"dt": "sample_time"}
GAIN = "gain"  # of the base, that an opening is multiplied by, whatever its name
PARAMETER, CONSTANT, SIGNAL, STATE, NUMBER = "parameter", "constant", "signal", "state", "number"


@njit(cache=True, nogil=True, inline="always")
def difference(command: float, position: float) -> float:
    """Error of the position, rad."""
    return command - position


CONTROLLER = Effect(
    name="controller",
    layer="actuator",
    parameters=(),
    meaning="the error of the position",
    source="",
    experiment="",
    advice="",
    blocks=(Block(difference, ("command", "position"), ("error",), ()),),
)
OF_EVERY_CHAIN = (CONTROLLER, MOMENT_ARM)


@dataclass(frozen=True)
class Ref:
    """What a name in an effect's file stands for: its kind and a column (of a parameter), a name or the text of a number."""

    kind: str
    name: str
    column: int = -1


@dataclass(frozen=True)
class Call:
    """A function and what its arguments are."""

    function: Callable[..., float]
    args: tuple[Ref, ...]


@dataclass(frozen=True)
class Link:
    """A block in its place.

    Attributes:
        name: of the variable that says whether it is present. place: rank in the table of effects.
        call: None for a delay. outs: signals and states. shows: owner and names that say whether it is present.
        when: columns of which one is not 0 where it is present; none: always.
        undo, only_delays: as of the block. by: column of a delay. of_the_log, logged: as of its effect and a delay.
        starts: state → number, signal, law or balance.
    """

    name: str
    place: int
    call: Call | None
    outs: tuple[Ref, ...]
    shows: tuple[str, tuple[str, ...]]
    when: tuple[int, ...] = ()
    undo: Call | None = None
    only_delays: bool = False
    by: int = -1
    of_the_log: bool = False
    logged: bool = False
    starts: Mapping[str, float | Ref | Call | tuple[Call, Call]] | None = None

    @property
    def reads(self) -> set[str]:
        """Names of the signals and states that it reads."""
        if self.call is None:
            return {out.name for out in self.outs}
        return {ref.name for ref in self.call.args if ref.kind in (SIGNAL, STATE)}

    @property
    def writes(self) -> set[str]:
        return {out.name for out in self.outs}

    @property
    def columns(self) -> set[int]:
        """Columns that it reads itself, constants not counted."""
        starts = [s for s in (self.starts or {}).values() if isinstance(s, Call)]
        calls = [call for call in (self.call, *starts) if call]
        return {ref.column for call in calls for ref in call.args if ref.kind == PARAMETER} | ({self.by} - {-1})

    @property
    def balance(self) -> str | None:
        """The state whose start only the whole trial tells."""
        return next((name for name, start in (self.starts or {}).items() if isinstance(start, tuple)), None)


@dataclass(frozen=True)
class Constant:
    """Constants in their place; when: as of a link."""

    names: tuple[str, ...]
    call: Call
    when: tuple[int, ...]
    neutral: float


class Chain:
    """A base model with effects.

    Attributes:
        base, effects: those it was made of. fields: (owner, name) of each column of a row of parameters.
        constants: in an order in which each needs only those before it.
        moved_by: state → signal by which it moves between −1 and 1. late: delays of inputs, which come first.
        ahead: links that hang on inputs alone. core: what else lies in front of the base's law. behind: what lies behind it.
        law, plain, needed: of the base. gain: column of its parameter that an opening is multiplied by.
    """

    def __init__(self, base: Base, effects: Iterable[Effect]) -> None:
        self.base, self.effects = base, tuple(effect for effect in effects if effect.blocks)
        self.fields: tuple[tuple[str, str], ...] = (
            *(("base", name) for name in base.parameters),
            *((effect.name, p.name) for effect in self.effects for p in effect.parameters),
            *(("setting", name) for name in SETTING),
        )
        self._columns = {field: i for i, field in enumerate(self.fields)}
        self.neutral: dict[str, float | Ref] = {
            name: value if isinstance(value, float) else self._named("", value)
            for name, value in (NEUTRAL | base.signals).items()
        }
        self._states = {state.name for effect in self.effects for state in effect.states} - {*base.lacks}
        self.moved_by = {s.name: s.moved_by for effect in self.effects for s in effect.states if s.moved_by}
        owned = [*base.constants, *(c for effect in self.effects for c in effect.constants)]
        self._constants = {name for constants in owned for name in constants.names}
        self.constants = self._ordered_constants()
        links = [link for effect in (*OF_EVERY_CHAIN, *self.effects) for link in self._links(effect, effect.name)]
        links = [link for link in links if not link.writes & {*base.lacks}]
        reachable = self._reachable(links)
        links = [link for link in links if link.writes & reachable]
        self._links_of = {n: [x for x in links if n in x.writes] for x in links for n in x.writes}
        self.links = [replace(x, when=tuple(dict.fromkeys(self._present(*x.shows, ())))) for x in links]
        self._links_of = {n: [x for x in self.links if n in x.writes] for x in self.links for n in x.writes}
        running = self._running()
        self.late = [x for x in self.links if x.call is None and x.writes <= set(INPUTS)]
        ahead = [x for x in self.links if x.name not in running and not x.writes & set(BEHIND) and x not in self.late]
        self.ahead = self._sorted(ahead)
        self.core = self._sorted([x for x in self.links if x.name in running and not x.writes & set(BEHIND)])
        at = {name: i for i, name in enumerate(BEHIND)}
        rest = [x for x in self.links if x.writes & set(BEHIND)]
        self.behind = sorted(rest, key=lambda x: (min(at[n] for n in x.writes if n in at), x.place))
        self.law, self.plain, self.needed = (self._call("", law) for law in (base.law, base.plain, base.needed))
        self.gain = self.column("base", base.gain)

    def column(self, owner: str, name: str) -> int:
        return self._columns[(owner, name)]

    def neutral_row(self) -> np.ndarray:
        """(P,) a row of parameters without any effect; those of the base are zero, settings those of 1 kHz."""
        row = np.zeros(len(self.fields))
        for effect in self.effects:
            for parameter in effect.parameters:
                row[self.column(effect.name, parameter.name)] = parameter.neutral
        row[[self.column("setting", name) for name in SETTING]] = list(SETTING.values())
        return row

    def writers(self, name: str) -> list[Link]:
        """Links that write a signal or state, in their order."""
        return [link for link in (*self.ahead, *self.core, *self.behind) if name in link.writes]

    def when(self, *names: str) -> tuple[int, ...]:
        """Columns of which one is not 0 where some of these signals, states or constants are written."""
        found = [c for name in names for link in self._links_of.get(name, ()) for c in link.when]
        found += [c for name in names for constant in self.constants if name in constant.names for c in constant.when]
        return tuple(dict.fromkeys(found))

    @cached_property
    def bent(self) -> tuple[int, ...]:
        """Columns of which one is not 0 where the plain law of the base does not hold."""
        plain = {ref.name for ref in self.plain.args}
        return self.when(*(r.name for r in self.law.args if r.name not in plain and r.name != "wound"), "effort")

    @cached_property
    def shared(self) -> set[str]:
        """States that other links read than the one which writes them."""
        return {n for n in self._states for x in self.links if n in x.reads - x.writes}

    def _named(self, owner: str, name: str) -> Ref:
        """What a name stands for."""
        owner, name = name.split(".") if "." in name else (owner, name)
        for place in (owner, "base"):
            if (place, name) in self._columns:
                return Ref(PARAMETER, name, self._columns[(place, name)])
        if name == GAIN:
            return Ref(PARAMETER, self.base.gain, self.column("base", self.base.gain))
        if ("setting", ALIASES.get(name, name)) in self._columns:
            return Ref(PARAMETER, name, self._columns[("setting", ALIASES.get(name, name))])
        if name in getattr(self, "_constants", ()):
            return Ref(CONSTANT, name)
        if name in getattr(self, "_states", ()):
            return Ref(STATE, name)
        if name in INPUTS or name in NEUTRAL or name in FEEDBACK or name in ("expected", "behind"):
            return Ref(SIGNAL, name)
        return Ref(SIGNAL, name) if owner == "" else self._unknown(owner, name)

    def _unknown(self, owner: str, name: str) -> Ref:
        written = {n for effect in self.effects for b in effect.blocks for n in getattr(b, "writes", ())}
        if name in written:
            return Ref(SIGNAL, name)
        if any(owner == effect.name for effect in self.effects):
            raise ValueError(
                f"effect '{owner}' reads '{name}', which is no parameter, constant, signal or state of the chain"
            )
        return Ref(NUMBER, "0.0")  # of an effect that the chain lacks

    def _call(self, owner: str, law: Law | Block | Constants) -> Call:
        return Call(law.function, tuple(self._named(owner, name) for name in law.reads))

    def _ordered_constants(self) -> list[Constant]:
        found = []
        for owner, constants in (("base", self.base.constants), *((e.name, e.constants) for e in self.effects)):
            for c in constants:
                refs = [self._named(owner, name) for name in c.reads]
                refs = [Ref(NUMBER, repr(NEUTRAL[ref.name])) if ref.kind == SIGNAL else ref for ref in refs]
                call = Call(c.function, tuple(refs))
                read = [self._named(owner, name) for name in c.when] or call.args
                own = tuple(r.column for r in read if r.kind == PARAMETER and self._bends(r.column))
                found.append(Constant(c.names, call, own, c.neutral))
        return found

    def _bends(self, column: int) -> bool:
        return self.fields[column][0] not in ("base", "setting")

    def _links(self, effect: Effect, owner: str) -> Iterable[Link]:
        place = [e.name for e in self.effects].index(owner) if effect not in OF_EVERY_CHAIN else -1
        for i, block in enumerate(effect.blocks):
            name = f"{owner}_{i}"
            if isinstance(block, Delay):
                by = self.column(owner, block.by)
                for signal in block.signals:
                    out = Ref(SIGNAL, signal)
                    shows, given = (owner, (block.by,)), {"only_delays": True, "by": by, "logged": block.logged}
                    yield Link(f"{name}_{signal}", place, None, (out,), shows, **given)
                continue
            outs = tuple(self._named("", n) for n in block.writes)
            starts = {s.name: self._start(owner, s) for s in effect.states if s.name in block.writes}
            yield Link(
                name,
                place,
                self._call(owner, block),
                outs,
                (owner, block.when),
                undo=self._call(owner, block.undo) if block.undo else None,
                only_delays=block.only_delays,
                of_the_log=effect.of_the_log,
                starts=starts,
            )

    def _start(self, owner: str, state: State) -> float | Ref | Call | tuple[Call, Call]:
        start = state.start
        if isinstance(start, str):
            return self._named(owner, start)
        if isinstance(start, Law):
            return self._call(owner, start)
        if isinstance(start, Balanced):
            return self._call(owner, start.limit), self._call(owner, start.known)
        return float(start)

    def _present(self, owner: str, names: tuple[str, ...], seen: tuple[str, ...]) -> list[int]:
        """Columns of which one is not 0 where one of these names is: a parameter, a constant, or a signal that is written."""
        found = []
        for name in names:
            ref = self._named(owner, name)
            if ref.kind == PARAMETER:
                found.append(ref.column)
            if ref.kind == CONSTANT:
                found += next(constant.when for constant in self.constants if name in constant.names)
            for link in self._links_of.get(name, ()) if ref.kind in (SIGNAL, STATE) else ():
                if link.name not in seen:
                    found += self._present(*link.shows, (*seen, link.name))
        return found

    def _aliases(self, names: Iterable[str]) -> set[str]:
        """The names and those that they are the same as where nothing writes them."""
        found = set(names)
        for name in list(found):
            while isinstance(self.neutral.get(name), Ref) and self.neutral[name].kind != PARAMETER:
                name = self.neutral[name].name
                found.add(name)
        return found

    def _reachable(self, links: list[Link]) -> set[str]:
        """Names that the base's law or the measured torque hang on."""
        seen = self._aliases({*self.base.law.reads, *self.base.plain.reads, "lost", "measured", "effort"})
        while True:
            undone = [{r.name for r in x.undo.args} for x in links if x.undo and x.writes & seen]
            started = [
                {s.name} for x in links if x.writes & seen for s in (x.starts or {}).values() if isinstance(s, Ref)
            ]
            more = self._aliases(seen.union(*(x.reads for x in links if x.writes & seen), *undone, *started))
            if more == seen:
                return seen
            seen = more

    def _running(self) -> set[str]:
        """Links that hang on what only a running model knows."""
        names, found = set(FEEDBACK), set()
        while True:
            more = {x.name for x in self.links if x.reads & names}
            if more == found:
                return found
            found = more
            names |= {n for x in self.links if x.name in found for n in x.writes}

    def _before(self, link: Link, links: list[Link]) -> set[str]:
        """Links that must come before a link."""
        found = set()
        for name in self._aliases(link.reads):
            for other in links:
                if name in other.writes and other is not link:
                    both = name in link.writes
                    if not both or (other.place, other.name) < (link.place, link.name):
                        found.add(other.name)
        if link.balance:
            after, names = {link.name}, set(link.writes)
            while more := {x.name for x in links if self._aliases(x.reads) & names} - after:
                after |= more
                names |= {n for x in links if x.name in after for n in x.writes}
            found |= {x.name for x in links} - after
        return found

    def _sorted(self, links: list[Link]) -> list[Link]:
        """In an order in which each signal is written before it is read, otherwise that of the table."""
        waiting, done = list(links), []
        needs = {link.name: self._before(link, links) for link in links}
        while waiting:
            ready = next((x for x in waiting if needs[x.name] <= {d.name for d in done}), None)
            if ready is None:
                raise ValueError(f"blocks wait for each other: {', '.join(x.name for x in waiting)}")
            waiting.remove(ready)
            done.append(ready)
        return done
