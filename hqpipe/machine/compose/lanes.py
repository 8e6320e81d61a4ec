"""Source of one sample of many joints, or of many windows of one: each link is a plain loop over these lanes.

So the compiler works on several lanes per instruction, and a link that none of them has is left out.
"""

from __future__ import annotations

from collections.abc import Iterable

from hqpipe.machine.compose.source import Source, call
from hqpipe.machine.compose.wiring import NUMBER, SIGNAL, STATE, Chain, Link, Ref

PASSES = ("inner", "grip", "turned", "lost", "effort")  # what comes about behind the law, in this order


class Lanes:
    """The source of a function in which a signal is an array over lanes; a subclass says where the rest stands."""

    FLAG = "on[{}]"  # whether some lane has a link

    def __init__(self, source: Source, chain: Chain, known: Iterable[str], of_the_log: bool) -> None:
        self.source, self.chain, self.known = source, chain, set(known)
        links = (*chain.late, *chain.ahead, *chain.core, *chain.behind)
        self.links = [x for x in links if of_the_log or not (x.logged or x.of_the_log)]
        self.flags: list[tuple[int, ...]] = []
        self.buffers: list[str] = []
        self.wound = "wound"  # array with the torque of the base
        measured = [name for x in self.links for name in x.writes if name == "measured"]
        self.loaded = chain.when("lost", "effort", *measured)

    def place(self, ref: Ref) -> str:
        """A parameter, a constant or a state of lane i."""
        raise NotImplementedError

    def element(self, array: str) -> str:
        """Lane i of what `array` or `buffer` names."""
        return f"{array}[i]"

    def on(self, when: Iterable[int]) -> str:
        """Whether some lane has links with these columns."""
        when = tuple(when)
        if when not in self.flags:
            self.flags.append(when)
        return self.FLAG.format(self.flags.index(when))

    def text(self, ref: Ref) -> str:
        """A name inside a loop over i."""
        if ref.kind == NUMBER:
            return ref.name
        if ref.kind != SIGNAL:
            return self.place(ref)
        if ref.name == "wound":
            return self.element(self.wound)
        value = self.chain.neutral.get(ref.name)
        if ref.name in self.known or value is None or self.writers(ref.name):
            return self.element(ref.name)
        return self.text(value) if isinstance(value, Ref) else repr(value)

    def array(self, name: str) -> str:
        """The array of a signal."""
        if name == "wound":
            return self.wound
        value = self.chain.neutral.get(name)
        alias = isinstance(value, Ref) and value.kind == SIGNAL
        return self.array(value.name) if alias and name not in self.known and not self.writers(name) else name

    def is_array(self, name: str) -> bool:
        """Whether the array of a signal can be that of another one, too."""
        return True

    def writers(self, name: str) -> list[Link]:
        return [link for link in self.links if name in link.writes]

    def loop(self, *lines: str) -> None:
        with self.source.under("for i in range(size):"):
            self.source.add(*lines)

    def buffer(self, name: str) -> str:
        """Name of the array that a signal is written into."""
        if name not in self.buffers:
            self.buffers.append(name)
        return f"b_{name}"

    def need(self, names: Iterable[str]) -> None:
        """Give signals their neutral values; one that several links write gets an array of its own to write into."""
        for name in names:
            value, writers = self.chain.neutral.get(name), self.writers(name)
            if name in self.known or value is None or name == "wound":
                continue
            alias = isinstance(value, Ref) and value.kind == SIGNAL
            if alias:
                self.need([value.name])
            if not writers or not writers[0].when:
                continue
            if alias and len(writers) == 1 and self.is_array(self.array(value.name)):
                self.source.add(f"{name} = {self.array(value.name)}")
            else:
                given = self.text(value) if isinstance(value, Ref) else repr(value)
                self.loop(f"{self.element(self.buffer(name))} = {given}")
                self.source.add(f"{name} = {self.buffer(name)}")
            self.known.add(name)

    def link(self, link: Link) -> None:
        """One loop, where some lane has the link."""
        names = [out.name for out in link.outs if out.kind == SIGNAL]
        self.need([*sorted(link.reads), *names])
        outs = ", ".join(self.place(x) if x.kind == STATE else self.element(self.buffer(x.name)) for x in link.outs)
        made = call(self.source, link.call, self.text)
        self.known |= set(names)
        with self.source.under(f"if {self.on(link.when) if link.when else True}:"):
            self.loop(f"{outs} = {made}", *self.after_sample(link))
            self.source.add(*(f"{name} = {self.buffer(name)}" for name in names))

    def after_sample(self, link: Link) -> list[str]:
        """Lines of the loop of a link behind its call."""
        return []

    def behind(self, *names: str) -> None:
        """Links behind the law that write some signals, from its present torque on."""
        self.known -= {"inner", "effort", "grip", "lost"} & set(names)
        for link in self.links:
            if link in self.chain.behind and link.writes & set(names):
                self.link(link)
        self.need(name for name in ("inner", "lost", "effort") if name in names)

    def advance(self) -> None:
        """From the torque `wound` before a sample, which is `before` then, to `following` after it."""
        chain, source = self.chain, self.source
        source.add(f"before = {self.wound}")
        self.known.add("before")
        self.behind("inner")
        behind = [x for x in self.links if x in chain.behind]
        self.known.discard("effort")
        if slack := [x for x in behind if "effort" in x.writes]:
            self.known.discard("lost")
            self.need(["effort", "lost"])
            with source.under(f"if {self.on(slack[0].when)}:"):
                for link in (x for x in behind if "lost" in x.writes):
                    self.link(link)
            for link in slack:
                self.link(link)
        self.known -= {name for x in chain.core for name in x.writes}
        for link in chain.core:
            self.link(link)
        self.law("following")
        self.wound = "following"

    def measure(self, into: str) -> None:
        """What comes about behind the law, and the torque at the load cell into an array."""
        self.behind(*PASSES)
        self.source.add(f"measured = {into}")
        self.known.add("measured")
        effort, lost = (self.text(Ref(SIGNAL, name)) for name in ("effort", "lost"))
        self.loop(f"{self.element('measured')} = {effort} - {lost}")
        for link in self.links:
            if "measured" in link.writes:
                with self.source.under(f"if {self.on(link.when)}:"):
                    self.loop(f"{self.element('measured')} = {call(self.source, link.call, self.text)}")

    def law(self, out: str) -> None:
        """The base's law into an array, plain where nothing bends it."""
        chain, source = self.chain, self.source
        laws = (chain.plain, chain.law)
        self.need(sorted({ref.name for made in laws for ref in made.args if ref.kind == SIGNAL}))
        if chain.bent:
            with source.under(f"if {self.on(chain.bent)}:"):
                self.loop(f"{self.element(out)} = {call(source, chain.law, self.text)}")
        with source.under("else:" if chain.bent else "if True:"):
            self.loop(f"{self.element(out)} = {call(source, chain.plain, self.text)}")
