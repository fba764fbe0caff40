"""Solve: progressive refinement (Cohen, Chen, Wallace, Greenberg 1988), many shooters at a time.

    lights shoot -> the brightest patches shoot, in batches -> ... until little is unshot, which is taken to spread as the rest has
                 -> or all elements shoot at once, again and again, through what they see (`gather`)

Received light is summed per element; unshot light per element and patch. All of a batch's rows of transport go through a block of elements
before the next block, in the same order whatever the threads, so the same bytes come out. What is heavy is done by a `Labour`.

The ledger holds at every step, to rounding: emitted = absorbed + escaped + unshot (W, each channel).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.element import AREA, PX, PZ
from luxel.radiosity.gather import Sight
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.labour import Labour
from luxel.radiosity.patches import Tree, middles, patch_starts
from luxel.radiosity.transport import BLOCK, Elements, Occluders, Shooters, Visibility

BATCH = 128
_SHARE = 16  # of the patches, at most, shoot at a time: the brightest are known anew after each batch
_MOST_GROUPS = 512
_HERE = 5.0  # times the tolerance: what elements may still have to shoot of what they have received
SCALES = 0.5, 2.0  # of what elements pass on: beyond, there are too few rays to tell
_ROUNDING = 1e-6
SCALE_RANGE = 0.25, 4.0
"""The sum of a patch's row is put right by no more than this; what is left over counts as escaped."""


class Source(NamedTuple):
    """What shoots: a tree over elements, and where the hemicubes of its patches stand.

    Attributes:
        tree: Over the elements.
        numbers: (17, k) float32 of its elements.
        shooters: Of its patches, in order.
        resolution: Pixels along a face of their hemicubes.
        shines: It is a lamp, or as bright as one: what elements near it see of it is told by rays, and its rows are used as they are.
    """

    tree: Tree
    numbers: Array
    shooters: Shooters
    resolution: int
    shines: bool = False


def source_of(tree: Tree, numbers: Array, resolution: int) -> Source:
    """Each patch looks from its element nearest the centre, along its mean normal."""
    centers = np.ascontiguousarray(numbers[PX : PZ + 1, middles(tree, tree.patches, numbers[PX : PZ + 1].T)].T)
    return Source(tree, numbers, Shooters(tree.patches, centers, frames_of(tree.place[tree.patches, 4:7])), resolution)


def groups(tree: Tree) -> Array:
    """(p + 1,) int64: the same of at most `_MOST_GROUPS` groups of patches that follow each other, which are neighbours."""
    starts = patch_starts(tree)
    return np.append(starts[: -1 : -(-len(starts) // _MOST_GROUPS)], starts[-1])


def at_once(patches: int) -> int:
    """How many of so many patches shoot in a batch, at most."""
    return max(1, min(BATCH, patches // _SHARE))


class Step(NamedTuple):
    """A line of the ledger: watts per channel (3,), after so many shots."""

    shots: int
    emitted: Array
    absorbed: Array
    escaped: Array
    unshot: Array

    @property
    def unshot_fraction(self) -> float:
        """Of what was emitted, over the channels; 0 if nothing was."""
        total = float(self.emitted.sum())
        return float(self.unshot.sum()) / total if total > 0 else 0.0


@dataclass
class State:
    """Of a solve in progress; all a checkpoint needs.

    Attributes:
        received: (3, n) float32: irradiance so far, W/m2.
        direct: (3, n) float32: the part of it that came from lights.
        unshot: (3, n) float32: radiosity not yet shot, W/m2.
        power: (p, 3) float64: the same by patch, W.
        lights_left: Patches of the lights that have still to shoot.
        emitted: Of all lights, W; of those that have shot, what elements have received of theirs and what has escaped.
        shots, escaped: So far; escaped (3,) float64 watts. An element's own shots are not counted.
        ledger: One `Step` a batch.
        whole: False while a step changes it, until the ledger has its line: what is interrupted there is not to be kept.
    """

    received: Array
    direct: Array
    unshot: Array
    power: Array
    lights_left: int
    emitted: Array
    absorbed: Array = field(default_factory=lambda: np.zeros(3))
    escaped: Array = field(default_factory=lambda: np.zeros(3))
    shots: int = 0
    ledger: list[Step] = field(default_factory=list)
    whole: bool = True

    @property
    def left(self) -> Array:
        """(3,) float64: what elements have to shoot, W."""
        return np.asarray(self.power.sum(0))

    @property
    def left_here(self) -> float:
        """How much elements have to shoot, on the average, as a share of what they have received."""
        unshot, received = self.unshot.sum(0), self.received.sum(0)
        return float(np.divide(unshot, received, out=np.zeros_like(unshot), where=received > 0).mean(dtype=np.float64))

    def take_in(self, problem: Problem, gained: Array, threads: int, from_lights: bool = False) -> None:
        """Add what elements have gained, (3, n) float32 W/m2, to what they have received and will shoot."""
        tree, absorbed = problem.patches.tree, np.empty_like(self.power)
        area = problem.elements.numbers[AREA]
        jit.run(_absorb, threads, gained, problem.albedo, area, patch_starts(tree), self.received, self.unshot, self.power, absorbed)
        self.absorbed = self.absorbed + absorbed.sum(0)
        if from_lights:
            self.direct += gained

    def shoot_brightest(self, problem: Problem, rows: Rows, labour: Labour) -> int:
        """Let the brightest patches shoot; returns how many. `rows` are theirs."""
        tree, starts, total = problem.patches.tree, patch_starts(problem.patches.tree), self.power.sum(1)
        chosen = np.sort(np.argsort(-total, kind="stable")[: at_once(len(total))])
        chosen = chosen[total[chosen] > 0]
        radiosity = self.power[chosen] / (tree.place[tree.patches[chosen], 7].astype(np.float64))[:, None]
        gained, lost, _ = _shoot(problem, problem.patches, chosen, rows, radiosity, labour)
        self.whole = False
        self.escaped = self.escaped + lost
        for p in chosen:
            self.unshot[:, starts[p] : starts[p + 1]] = 0
        self.take_in(problem, gained, labour.threads)
        return len(chosen)

    def pass_on(self, problem: Problem, sight: Sight, labour: Labour) -> None:
        """Let all elements shoot at once what they have to shoot, through what they see."""
        gained, away = pass_on(sight, np.ascontiguousarray(self.unshot.T), problem.elements.numbers[AREA], labour)
        self.whole = False
        self.escaped = self.escaped + away
        self.unshot[:] = 0
        self.take_in(problem, gained, labour.threads)


class Rows:
    """Where rows of transport are kept: so many, in the order in which they are first wanted; the rest are computed each time.

    Attributes:
        rows: (slots, k) uint16, of this process's elements; if not all are kept, the last `BATCH` are not.
        touched: (slots, blocks) bool: which blocks of a row are not all zero.
        slot: (p,) int64: a patch's row, or -1.
        scale: (slots,) float64: what puts the row's sum right.
        lost: (slots,) float64: share of the shooter's light that reaches nothing.
        surplus: (slots,) float64: of a light, the share of its light by which what elements receive and what is lost is more than it was to send, or
            less.
    """

    def __init__(self, patches: int, elements: int, kept: int, empty: Callable[..., Any] = np.empty) -> None:
        """`empty(shape, dtype)` makes the array of rows."""
        self.kept = min(patches, kept)
        self.rows = empty((self.kept + (BATCH if self.kept < patches else 0), elements), np.uint16)
        self.touched = np.zeros((len(self.rows), -(-elements // BLOCK)), np.bool_)
        self.slot = np.full(patches, -1, np.int64)
        self.scale, self.lost, self.surplus = np.ones(len(self.rows)), np.zeros(len(self.rows)), np.zeros(len(self.rows))
        self.used = 0

    def place(self, patches: Array) -> tuple[Array, Array]:
        """Slots for these patches, and which of the rows are still to be computed."""
        slots, new = self.slot[patches], self.slot[patches] < 0
        keep = min(int(new.sum()), self.kept - self.used)
        fresh = np.flatnonzero(new)
        slots[fresh[:keep]] = np.arange(self.used, self.used + keep)
        self.slot[patches[fresh[:keep]]] = slots[fresh[:keep]]
        self.used += keep
        slots[fresh[keep:]] = self.kept + np.arange(len(fresh) - keep)
        return slots, fresh


class Problem(NamedTuple):
    """What is solved.

    Attributes:
        elements: n receivers; `own`: those that are this process's (`labour`).
        albedo: (3, n) float32.
        patches: They as shooters.
        lights: Emitting surfaces as shooters, or None.
        exitance: (k, 3) float32 of the elements of `lights`; the luxel of each, `point_luxel` (k,) int32, and its exitance relative to this,
            `point_share` (k, 3) float32.
        occluders: What hides.
        near: Metres; see `hemicube.see`.
        rays: See `Visibility`.
    """

    elements: Elements
    own: Elements
    albedo: Array
    patches: Source
    lights: Source | None
    exitance: Array
    point_luxel: Array
    point_share: Array
    occluders: Occluders
    near: float
    rays: Visibility


def start(problem: Problem, irradiance: Array | None = None, threads: int = 1) -> State:
    """The state before the first shot.

    Args:
        irradiance: (3, n) float32 that lights without a surface have already given, or None.
    """
    numbers, n = problem.elements.numbers, problem.elements.numbers.shape[1]
    area = numbers[AREA].astype(np.float64)
    emitted = np.zeros(3)
    if problem.lights is not None:
        emitted += problem.exitance.T.astype(np.float64) @ problem.lights.numbers[AREA].astype(np.float64)
    state = State(
        np.zeros((3, n), np.float32), np.zeros((3, n), np.float32), np.zeros((3, n), np.float32), np.zeros((len(problem.patches.tree.patches), 3)),
        0 if problem.lights is None else len(problem.lights.tree.patches), emitted,
    )  # fmt: skip
    if irradiance is not None:
        state.take_in(problem, irradiance, threads, from_lights=True)
        state.emitted += irradiance.astype(np.float64) @ area
    return state


@jit.parallel_kernel
def _absorb(queue, gained, albedo, area, starts, received, unshot, power, absorbed):
    """Add what each patch's elements have gained, and sum what the patch has to shoot and has kept."""
    p = jit.take(queue)
    while p < len(power):
        for channel in range(3):
            shot = kept = 0.0
            for i in range(starts[p], starts[p + 1]):
                e = gained[channel, i]
                received[channel, i] += e
                bounced = albedo[channel, i] * e
                unshot[channel, i] += bounced
                shot += np.float64(area[i]) * np.float64(unshot[channel, i])
                kept += np.float64(area[i]) * (np.float64(e) - np.float64(bounced))
            power[p, channel] = shot
            absorbed[p, channel] = kept
        p = jit.take(queue)


def fill(problem: Problem, source: Source, chosen: Array, rows: Rows, labour: Labour) -> Array:
    """Make sure of the rows of the chosen patches, at most `BATCH`; returns their slots."""
    slots, fresh = rows.place(chosen)
    if not len(fresh):
        return slots
    who = Shooters(*(array[chosen[fresh]] for array in source.shooters))
    seen, escaped = labour.see(problem.occluders, who, source.resolution, problem.near)
    to = slots[fresh]
    rays = problem.rays if source.shines or problem.rays.always else problem.rays._replace(number=0)
    parts = labour.fill_rows(problem.own, source.tree, source.numbers, who, seen, problem.occluders, rays, to, rows.rows)
    rows.touched[to] = parts > 0
    parts = labour.join(parts, -(-problem.elements.numbers.shape[1] // BLOCK), grain=1)
    sums, areas = parts.sum(1), source.tree.place[who.node, 7].astype(np.float64)
    if source.shines:  # what each element receives is known well: an error near the light is not put right by what is far away
        rows.lost[to] = np.clip(1.0 - sums / areas, 0.0, escaped.sum(1))
        rows.surplus[to] = sums / areas + rows.lost[to] - 1.0
        return slots
    leaks = escaped.any(1)  # only if it sees nothing but fronts is all of its light received
    scale = np.divide(areas, sums, out=np.ones(len(to)), where=sums > 0)
    scale[leaks] = np.minimum(scale[leaks], 1.0)  # what is passed on is never more than all
    rows.scale[to] = np.clip(scale, *SCALE_RANGE)
    rows.lost[to] = 1.0 - rows.scale[to] * sums / areas
    return slots


def complete(problem: Problem, source: Source, rows: Rows, labour: Labour) -> Rows:
    """Fill the rows of all patches, which `rows` must have room for."""
    missing = np.flatnonzero(rows.slot < 0)
    for first in range(0, len(missing), BATCH):
        fill(problem, source, missing[first : first + BATCH], rows, labour)
    return rows


def _shoot(problem: Problem, source: Source, chosen: Array, rows: Rows, radiosity: Array, labour: Labour) -> tuple[Array, Array, Array]:
    """What the chosen patches give at their mean radiosity (s, 3): irradiance (3, n) float32; the watts that reached nothing, (3,); and those that
    lights send beyond what they were to."""
    slots = fill(problem, source, chosen, rows, labour)
    gained = labour.receive(rows.rows, rows.touched, slots, (radiosity * rows.scale[slots][:, None]).astype(np.float32))
    areas = source.tree.place[source.tree.patches[chosen], 7].astype(np.float64)
    lost, more = ((radiosity * (areas * share[slots])[:, None]).sum(0) for share in (rows.lost, rows.surplus))
    return labour.join(gained, problem.elements.numbers.shape[1]), lost, more


def mean(values: Array, area: Array, tree: Tree) -> Array:
    """Area-weighted means (p, 3) float64 over patches, of values (k, 3) of their elements."""
    first, weight = tree.span[tree.patches, 0], area.astype(np.float64)
    return np.add.reduceat(values * weight[:, None], first, 0) / np.add.reduceat(weight, first)[:, None]


def light_steps(problem: Problem, state: State, rows: Rows, labour: Labour) -> Iterator[State]:
    """Let the lights shoot; yields the state after each batch. They have `rows` of their own."""
    lights = problem.lights
    while lights is not None and state.lights_left:
        chosen = np.arange(len(lights.tree.patches))[-state.lights_left :][:BATCH]
        radiosity = mean(problem.exitance, lights.numbers[AREA], lights.tree)[chosen]
        gained, lost, more = _shoot(problem, lights, chosen, rows, radiosity, labour)
        state.whole = False
        state.escaped = state.escaped + lost
        state.emitted = state.emitted + more
        state.lights_left -= len(chosen)
        state.take_in(problem, gained, labour.threads, from_lights=True)
        _write(state, problem, len(chosen))
        yield state


def patch_steps(problem: Problem, state: State, rows: Rows, tolerance: float, labour: Labour) -> Iterator[State]:
    """Let the brightest patches shoot until what is unshot is below `tolerance` of what was emitted; yields the state after each batch."""
    while labour.once(lambda: _much(state, tolerance)):
        _write(state, problem, state.shoot_brightest(problem, rows, labour))
        yield state


def pass_on(sight: Sight, light: Array, area: Array, labour: Labour) -> tuple[Array, Array]:
    """Let all elements shoot: the irradiance of all, (3, n) float32 W/m2, and what goes away, (3,) float64 W.

    From each element as much goes away as of its own rays do (reciprocity), and the rest is received. What is gathered sums up to that but for the
    chance of the directions, some tenths of a per cent, and is scaled to it.

    Args:
        sight: With `hits` of this process's elements, and `away` of all.
        light: (n, 3) float32 radiosity, W/m2; `area` (n,) float32, m2.
    """
    irradiance = labour.join(labour.bounce(sight, light), len(light))
    light = light.T.astype(np.float64)
    sent = light @ area
    scale, away = balance(sent, sent - light @ sight.away, irradiance.astype(np.float64) @ area)
    irradiance *= scale[:, None].astype(np.float32)
    return irradiance, away


def balance(sent: Array, wanted: Array, got: Array) -> tuple[Array, Array]:
    """What what is gathered is to be multiplied by, (3,) float64, and what goes away, of the watts that are sent, should arrive, and do."""
    scale = np.clip(np.divide(wanted, got, out=np.ones(3), where=got > 0), *SCALES)
    return scale, sent - np.where(np.abs(scale * got - wanted) <= _ROUNDING * wanted, wanted, scale * got)


def element_steps(problem: Problem, state: State, sight: Callable[[], Sight], tolerance: float, labour: Labour) -> Iterator[State]:
    """Let all elements shoot at once, through what they see; yields the state after each time.

    Until what is unshot is below `tolerance` of what was emitted, and little of what luxels have received: under a sky little of all the light is
    much of what comes through a window.
    """
    while labour.once(lambda: _much(state, tolerance) or state.left_here > _HERE * tolerance):
        state.pass_on(problem, sight(), labour)
        _write(state, problem, 0)
        yield state


def note_end(problem: Problem, state: State) -> Iterator[State]:
    """The state, with a line in the ledger, where there was nothing to shoot at all: lamps without a surface shine on what is black."""
    if not state.ledger:
        _write(state, problem, 0)
        yield state


def _much(state: State, tolerance: float) -> bool:
    """Whether there is still light to shoot."""
    return bool(state.left.sum() > tolerance * state.emitted.sum())


def _write(state: State, problem: Problem, shots: int) -> None:
    """A line of the ledger, after so many shots more."""
    state.shots += shots
    left, lights = np.zeros(3), problem.lights
    if state.lights_left and lights is not None:
        rest = lights.tree.span[lights.tree.patches[-state.lights_left :], 0].min()
        left = problem.exitance[rest:].T.astype(np.float64) @ lights.numbers[AREA, rest:].astype(np.float64)
    state.ledger.append(Step(state.shots, state.emitted.copy(), state.absorbed.copy(), state.escaped.copy(), state.left + left))
    state.whole = True


def ambient(problem: Problem, state: State) -> Array:
    """(3,) float64 W/m2: the irradiance that all the unshot light would make if it spread evenly (Cohen et al. 1988, eq. 12)."""
    return _still_to_come(problem, state) / problem.elements.numbers[AREA].sum(dtype=np.float64)


def settled(problem: Problem, state: State, elements_shoot: bool) -> Array:
    """(3, n) float32 W/m2: the irradiance of elements once the little that is unshot has spread, too.

    Bounce after bounce light comes to be spread alike. So the rest is spread as what has just been received and is not yet passed on, if elements
    shoot; else as all that was: where no light comes, none of the rest does, and a dim room has none of a bright one's.
    """
    area, last = problem.elements.numbers[AREA].astype(np.float64), state.received
    if elements_shoot:
        last = np.divide(state.unshot, problem.albedo, out=np.zeros_like(state.unshot), where=problem.albedo > 0)
    there = last.astype(np.float64) @ area
    more = np.divide(_still_to_come(problem, state), there, out=np.zeros(3), where=there > 0)
    return np.asarray(state.received + last * more[:, None].astype(np.float32))


def _still_to_come(problem: Problem, state: State) -> Array:
    """(3,) float64 W: what elements will receive of the unshot light, bounce after bounce, if none escapes."""
    area = problem.elements.numbers[AREA].astype(np.float64)
    mean = (problem.albedo.astype(np.float64) @ area) / area.sum()
    return np.asarray(state.left / (1.0 - np.minimum(mean, 0.99)))
