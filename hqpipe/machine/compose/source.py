"""Python source of compiled functions, line by line, and how a link reads in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from hqpipe.machine.compose.wiring import CONSTANT, NUMBER, PARAMETER, SIGNAL, STATE, Call, Chain, Link, Ref

Text = Callable[[Ref], str]
JIT = '@njit(cache=CACHE, nogil=True, error_model="numpy")'


class Source:
    """Lines of a module under way, and the functions of effects that it imports."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._indent = 0
        self._imported: dict[tuple[str, str], str] = {}

    def add(self, *lines: str) -> None:
        """Append lines at the present depth."""
        self._lines += ["    " * self._indent + line if line else "" for line in lines]

    @contextmanager
    def under(self, head: str) -> Iterator[None]:
        """A line and what is indented below it."""
        self.add(head)
        self._indent += 1
        yield
        self._indent -= 1

    @contextmanager
    def hole(self) -> Iterator[list[str]]:
        """Lines to be filled in here once what follows is known."""
        at, indent, lines = len(self._lines), self._indent, []
        yield lines
        self._lines[at:at] = ["    " * indent + line for line in lines]

    @contextmanager
    def function(self, name: str, args: str, says: str) -> Iterator[None]:
        """A compiled function."""
        self.add("", "", JIT)
        with self.under(f"def {name}({args}):"):
            self.add(f'"""{says}"""')
            yield

    def name_of(self, function: Callable) -> str:
        """The name under which a function of an effect is imported."""
        key = (function.__module__, function.__name__)
        if key not in self._imported:
            taken = set(self._imported.values())
            name = f"f_{key[1]}"
            self._imported[key] = name if name not in taken else f"{name}_{len(taken)}"
        return self._imported[key]

    def text(self, head: str) -> str:
        """The whole module; head: what goes before its functions, beside their imports."""
        imports = [f"from {module} import {name} as {short}" for (module, name), short in self._imported.items()]
        return "\n".join([head, *imports, *self._lines, ""])


def call(source: Source, made: Call, text: Text) -> str:
    """A call with its arguments."""
    return f"{source.name_of(made.function)}({', '.join(map(text, made.args))})"


def started(source: Source, start: float | Ref | Call, text: Text) -> str:
    """What a state is at the first sample."""
    if isinstance(start, Call):
        return call(source, start, text)
    return text(start) if isinstance(start, Ref) else repr(start)


def present(columns: Iterable[int], parameter: Callable[[int], str] = "p[{}]".format) -> str:
    """Whether one of the columns is not 0."""
    return " or ".join(f"{parameter(c)} != 0.0" for c in columns) or "True"


def scalar(ref: Ref) -> str:
    """A name in straight-line code: parameters in `p`, all else in variables."""
    if ref.kind == PARAMETER:
        return f"p[{ref.column}]"
    return {CONSTANT: "c_", SIGNAL: "", STATE: "m_", NUMBER: ""}[ref.kind] + ref.name


def constants(source: Source, chain: Chain, only: set[str] | None = None) -> None:
    """Values of the constants into variables; only: those that are needed."""
    for constant in chain.constants:
        if only is not None and not only & set(constant.names):
            continue
        names = ", ".join(f"c_{name}" for name in constant.names)
        value = call(source, constant.call, scalar)
        if constant.when:
            source.add(*(f"c_{name} = {constant.neutral!r}" for name in constant.names))
            with source.under(f"if {present(constant.when)}:"):
                source.add(f"{names} = {value}")
        else:
            source.add(f"{names} = {value}")


def constants_of(chain: Chain, calls: Iterable[Call]) -> set[str]:
    """Names of the constants that some calls need, directly or through others."""
    found = {ref.name for made in calls for ref in made.args if ref.kind == CONSTANT}
    for constant in reversed(chain.constants):
        if found & set(constant.names):
            found |= {ref.name for ref in constant.call.args if ref.kind == CONSTANT}
    return found


class Straight:
    """Straight-line code of links in one scope: each signal gets its neutral value before it is first needed."""

    def __init__(self, source: Source, chain: Chain, known: Iterable[str], text: Text = scalar) -> None:
        self.source, self.chain, self.known, self.text = source, chain, set(known), text

    def need(self, names: Iterable[str]) -> None:
        """Give signals that nothing has written yet their neutral values."""
        for name in names:
            if name not in self.known and name in self.chain.neutral:
                value = self.chain.neutral[name]
                if isinstance(value, Ref):
                    if value.kind == SIGNAL:
                        self.need([value.name])
                    value = self.text(value)
                self.source.add(f"{name} = {value}")
                self.known.add(name)

    def needs_of(self, made: Call) -> None:
        self.need(ref.name for ref in made.args if ref.kind == SIGNAL)

    def link(self, link: Link, when: str | None = None) -> None:
        """A link, where it is present."""
        self.needs_of(link.call)
        self.need(out.name for out in link.outs if out.kind == SIGNAL)
        line = f"{', '.join(map(self.text, link.outs))} = {call(self.source, link.call, self.text)}"
        if when is None and not link.when:
            self.source.add(line)
        else:
            with self.source.under(f"if {when or present(link.when)}:"):
                self.source.add(line)

    def started(self, links: Iterable[Link], when: str = "True") -> None:
        """The states of links as they begin, where `when` holds."""
        starts = {name: start for link in links for name, start in link.starts.items()}
        if not starts:
            return
        for start in starts.values():
            if isinstance(start, Call):
                self.needs_of(start)
        with self.source.under(f"if {when}:"):
            for name, start in starts.items():
                self.source.add(f"{self.text(Ref(STATE, name))} = {started(self.source, start, self.text)}")

    def law(self, out: str) -> None:
        """The base's law into a variable, plain where nothing bends it."""
        self.needs_of(self.chain.law)
        self.needs_of(self.chain.plain)
        plain = f"{out} = {call(self.source, self.chain.plain, self.text)}"
        if not self.chain.bent:
            self.source.add(plain)
            return
        with self.source.under(f"if {present(self.chain.bent)}:"):
            self.source.add(f"{out} = {call(self.source, self.chain.law, self.text)}")
        with self.source.under("else:"):
            self.source.add(plain)

    def anew(self, *names: str) -> None:
        """Forget signals, so that they get their neutral values again."""
        self.known -= set(names)

    def behind(self, names: set[str], of_the_log: bool) -> None:
        """Links behind the base that write some signals, from the present `wound` on."""
        self.anew(*({"inner", "effort", "grip", "lost"} & names))
        for link in self.chain.behind:
            if link.writes & names and (of_the_log or not link.of_the_log):
                self.link(link)
        self.need(sorted({"inner", "effort", "lost"} & names))

    def unmeasured(self, link_value: str) -> None:
        """The torque behind the chain from the one at the load cell, into `behind`."""
        self.source.add(f"measured = {link_value}")
        self.known.add("measured")
        for link in reversed([x for x in self.chain.behind if "measured" in x.writes and x.undo]):
            with self.source.under(f"if {present(link.when)}:"):
                self.source.add(f"measured = {call(self.source, link.undo, self.text)}")
        self.source.add("behind = measured")

    def unloaded(self) -> None:
        """Torque in front of the friction that leaves `behind`, into `inner` and `wound`, and their difference into `lost`."""
        lost = [x for x in self.chain.behind if "lost" in x.writes]
        self.anew("lost")
        self.need(["lost"])
        for link in lost:
            if link.undo is None:
                self.link(link)
        self.source.add("inner = behind + lost")
        self.known.add("inner")
        for link in reversed([x for x in lost if x.undo]):
            self.needs_of(link.undo)
            with self.source.under(f"if {present(link.when)}:"):
                self.source.add(f"inner = {call(self.source, link.undo, self.text)}")
        self.source.add("lost = inner - behind", "wound = inner")

    def rewound(self) -> None:
        """`wound` from `expected`, `behind` and `lost`, where something lies between."""
        for link in [x for x in self.chain.behind if "effort" in x.writes and x.undo]:
            with self.source.under(f"if {present(link.when)}:"):
                self.source.add(f"wound = {call(self.source, link.undo, self.text)}")
