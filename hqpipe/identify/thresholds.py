"""The dozen numbers that decide which effects are causes; what follows from one of them stands below it.

Each is an assumption about what a simulator or a report needs, but for `OVERSTATED`. What a fit or a search needs to end stands
where it is used: it decides how long a computation takes, and no name. Majorities, of joints or of probability, and the least
and the greatest length of a stretch of time (`stretches.py`) stand where they are used, too, though names hang on them.
"""

from __future__ import annotations

from typing import Final

LEAST_RISE: Final = 0.1
"""Share by which the squared error must grow without an effect for it to be a cause: 5 % of the error. An effect with less is
of no use to a simulator; where no model is exact, ever smaller effects are significant without end. The cost: a real one that
small is not named."""
LEAST_GAIN: Final = LEAST_RISE / 2.0
"""The same for the search to go on from a set with the effect, as two effects may close a share together. Where no more of
a gap is left, it is explained. The cost: a stand-in that leaves so little gets a name."""
WITHIN_BAND: Final = 1.0 - LEAST_RISE
"""Of the square of what effects do, that lies below the highest frequency at which they act: the rest is edges. The cost: a law
that is missing and faster does not count as unknown."""

MATERIAL: Final = 0.005
"""Of the output's spread: a change of the error by less is of no use to a simulator. The cost: as of `LEAST_RISE`."""

STRONGER: Final = 2.0
"""How many times as strong motion may be as in the logs. It shows an effect of usual size that much more, so `LEAST_RISE` and
`LEAST_GAIN` of such a one are smaller by the square of this: a simulator is asked for motion that no log holds. The cost: what
refines the law of another cause, and has that size, may get a name."""
USUAL_SIZE: Final = 1.0 / STRONGER
"""Size over what a data sheet of such a machine would give, from which an effect is of usual size: what motion as strong shows
as much as a data sheet's size does in the logs. The cost: a smaller one has to take off the whole of `LEAST_RISE`."""

SLIGHT: Final = 0.1
"""Size over what a data sheet of such a machine would give, below which a cause also has to close `LEAST_SHARE` of the squared
gap: a gain unequal by 1 % where 10 % are usual is none if it does no more than refine another law. The cost: a real one that
small is not named beside another cause."""
LEAST_SHARE: Final = SLIGHT**2
"""Square of what a cause does to the prediction, over the squared gap from the base's error to the noise: a tenth of the gap.
What does less refines the law of another cause. It is not asked to close that share by itself: of a delay and a lag of like
size either one can take most of the other's part. Of the held-out errors it is the share that a cause must close. The cost: a
real effect that small beside a large one is not named."""

HALVED: Final = 0.5
"""Of a squared error, that chance does not take off: another answer leaves less where nothing else speaks for it, and a cause
closes as much of what the set without generic shapes leaves above the noise. By chance the best of a dozen effects explains a
third of a law that is missing, as the best of twelve random directions in a space of ten shapes does in half of all cases. The
cost: a right answer that explains less is not given, and a smaller effect counts as unknown."""
BORNE_OUT: Final = HALVED**2
"""Of the square of what a cause of few joints does to the prediction of the held-out trials, that it must take off their
squared error. One that has the fitted size there takes off all of it, one that is not there adds as much. Seen: 0.66 and more
for 316 causes that were there, 0.2 and less for four of five that were not; 0.43 and more for 118 in two machines of another
simulator, for which no law is exact. The cost: one that is less than five eighths as large in these trials as in the others."""

OVERSTATED: Final = 10.0
"""How many times more the errors of a joint seem to say for an effect that most joints of the machine do not have, against
nothing or a cause of most joints in its place, than they do. They are judged by how they scatter, but what a law leaves out is
a function of more than position and speed, and in one joint of a dozen some effect describes most of it. Seen in mixtures of
effects that were set aside for this: such stand-ins, for which ln B was 14 to 45. The cost: what few joints have, and show so
faintly."""

CONFUSED: Final = 0.05
"""Probability of a set with another effect instead, from which both are said to be alike. The cost: a less probable one is not
listed, nor taken."""

EXPECTED: Final = 1.0
"""Effects and generic shapes of a joint beforehand: logs are diagnosed because something is wrong. The cost: a decade moves ln
odds by 2.3."""
EXPECTED_LIKE: Final = 3.0
"""Joints that this expectation counts as, beside the other joints of the machine. The cost: few joints say little of each
other."""

BLOCK: Final = 3.0
"""Autocorrelation times of a block of errors: neighbouring ones then share a few per cent. The cost: errors that stay alike for
long leave few blocks."""
CELLS: Final = 6
"""Of position, and of speed: a law that is wrong errs in one way over a sixth of the range, and one part in the square of this
number of what it errs looks like any one parameter. The cost: motion that is repeated counts little."""

QUIET: Final = 0.15
"""Excess of the squared error outside a stretch of time over that inside, above the noise, at which the base is nearly right
outside. The cost: what acts for some time beside lasting effects is not found."""
