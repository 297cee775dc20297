"""The memory that the kernel works on: one `Group` record a subsystem, its `Source`s, and the `Run`; `Request`s for what it left
and `Evaluation`s of what it did not look at.

All fields are 8 bytes; Python fills them through `dialect.RecordArray`, machine code reads and writes them in place. Everything that a run needs to go on
is in here, so that the kernel can return to Python at any step and be called again.
"""

from __future__ import annotations

from hierc.runtime.machine.dialect import Array, Lanes, Record

# What a step returns.
ACCEPTED = 0.0  # one step done
WAITING = 1.0  # what it reads is not known yet up to the end of its step
FULL = 2.0  # no room for another segment
TOO_SMALL = 3.0  # the step size fell to the spacing of doubles at t
NOT_FINITE = 4.0  # the right-hand side stayed NaN or infinite however small the step
TOO_MANY = 5.0  # the group has taken as many steps as it may
REVIEW = 8.0  # whether its method is still the right one is to be looked at
# What the kernel returns beside these.
DONE = 6.0
PAUSED = 7.0  # the budget of this call is used up


#: What is counted of each group.
COUNTERS = (
    "steps", "rejected", "evaluations", "iterations", "jacobians", "factorizations", "failures", "spacings",
)  # fmt: skip


class Source(Record):
    """One earlier group that a group reads: `count` of its channels, evaluated into the inputs from `first` on."""

    group: int
    first: int
    count: int
    cursor: int  # the segment that was read last


class Group(Record):
    """A subsystem under integration. Arrays of lanes are as wide as its method's; `n` states."""

    # time and step size
    t: float
    h: float  # proposed next step size; 0 before the first
    end: float  # where the step under trial ends
    trial: float  # its size
    previous: float  # size of the last accepted step
    usual: float  # size of steps lately: falls by half of what smaller ones go on
    stop: float
    max_step: float
    min_step: float
    # step-size control
    rtol: float
    floor: float  # absolute tolerance of what other groups read beside the states
    last_error: float
    last_size: float
    rate: float  # convergence rate of the last Newton iteration
    contraction: float  # rate/(1 - rate), carried from step to step
    rejections: int  # in a row, at this step
    fresh: int  # 1 where the last segment can predict this step
    origin: float  # where the history of a multistep method begins
    spacing: float  # the distance of what it holds of it
    mark: float  # where its steps must end: the next knot of what it reads
    grown: float  # when they last became longer
    ceiling: float  # what failed trials say of their size
    newton_tolerance: float
    # order control, of methods whose order varies
    order_now: int
    alike: int  # accepted steps of equal size in a row
    regular: int  # rows of the method's tables that are those of equal steps
    began: int  # segments there were when the method began
    # whether the method is the right one
    watched: int  # 1 where stability is looked at
    stiffness: float  # the step times how fast the right-hand side moves with the states, in the last two evaluations of a step
    limited: int  # steps lately that stability seems to bound
    review: int  # the number of steps at which to ask
    patience: int  # the number of steps before which stability is no reason to ask …
    alarm: float  # … unless steps are shorter than this
    # states, values of parameters, tolerances; these arrays are parts of one block
    n: int
    x: Array[float]
    p: Array[float]
    absolute: Array[float]  # absolute tolerance of each state
    u: Array[Lanes]
    work: Array[Lanes]
    # inputs
    source_count: int
    sources: Array[Source]
    channels: Array[int]  # of each input: place of its coefficients in the segment it is read from
    inputs: int
    published: int  # channels after the states
    # segments: t0, t1, 1/h, h, then `width` coefficients a channel; the states are the first channels
    track: Array[float]
    first: int  # number of the first segment kept
    count: int  # segments made so far
    capacity: int
    stride: int
    width: int
    degree: int
    # code
    step: int  # addresses: one step with this group's method …
    initial: int  # … and its pieces, see the method
    begin: int
    refresh: int
    iterate: int
    estimate: int
    defect: int
    accept: int
    attempt: int
    correct: int
    linear: int  # 1 where the Jacobian is constant: one Newton iteration is exact
    order: float  # of the error estimate: err ~ h**order
    clocks: Array[int]  # ticks and calls of each part of its steps, where they are timed
    # counters
    steps: int
    most_steps: int  # that it may take
    rejected: int
    evaluations: int
    iterations: int
    jacobians: int
    factorizations: int
    failures: int  # of Newton iterations
    spacings: int  # of a multistep method's history that were made


class Run(Record):
    """Where a run stands: the window under way and the group to go on with."""

    stop: float
    window: float  # end of the window
    group: int
    groups: int
    budget: int  # step attempts left in this call
    moved: int  # 1 where a group has made a step in this window


class Request(Record):
    """Channels of one group that are wanted at some times: its segments, and the places of the channels' coefficients in them."""

    track: Array[float]
    count: int
    stride: int
    degree: int
    places: Array[int]
    channels: int


class Evaluation(Record):
    """A function of one element, which `code` evaluates at all times: it reads rows `places` of a world and sets rows `targets`."""

    code: int
    places: Array[int]
    targets: Array[int]
    p: Array[float]
