"""Faults V1 to V5: cameras that fail, pictures that lie, and tables with nothing to do."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value

from tests.robustness.rig.fault import Case, Fault
from unwrinkle.flattening import policy
from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.state import RunStatus
from unwrinkle.flattening.station_messages import HeadImage
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.range_mapping import range_map_from_capture
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.systems.perception.stereo import StereoPerceptionSystem
from unwrinkle.testing import cells
from unwrinkle.testing.scripted_station import (
    LoopRun,
    Script,
    depth_cell,
    run_loop,
    towel_capture,
)
from unwrinkle.testing.table import GARMENT_CENTRE, TABLE
from unwrinkle.testing.traced_pair import TracedPair, traced_pair

_CENTRE = (0.0, -1.10)
_RIDGE = Ridge((-0.02, -1.10), 1.25, 0.021, 0.0125, 0.30)
_TOWEL = Towel((_RIDGE,), _CENTRE, thickness=0.004)
#: Single layers of these thicknesses, m, under this many seeds of noise: how often is a flat one
#: pulled?
_LAYERS, _SEEDS = (0.002, 0.004), 4


def _seen(seed: int, shift: float = 0.0) -> TracedPair:
    """Return the pictures of a towel that lies `shift` further along x, m."""
    towel = Towel((Ridge((-0.05 + shift, -1.10), 1.3, 0.022, 0.016, 0.30),), (shift, -1.10))
    return traced_pair(towel, texture_seed=seed, noise_seed=seed)


def _perceive(left: HeadImage, right: HeadImage) -> Perceived:
    """Return what the perception system makes of two pictures."""
    head = nominal_calibration().stereo_head(cells.cell().limits.head)
    system = StereoPerceptionSystem(cells.cell(), head)
    context = system.CreateDefaultContext()
    for name, image in (("left_image", left), ("right_image", right)):
        system.GetInputPort(name).FixValue(context, Value(image))
    found: Perceived = system.GetOutputPort("range_map").Eval(context)
    return found


def _nothing_moved(case: Case, run: LoopRun) -> None:
    case.expect(run.sent == (), "nothing was sent to arms or grippers", run.sent)
    case.expect(np.array_equal(run.stands, run.start), "the arms stand where they stood")


def drop_out(case: Case) -> None:
    """V1: camera drop-out, time-out, one of two cameras."""
    looks: list[int] = []

    def raising(number: int) -> Capture:
        looks.append(number)
        raise TimeoutError("no frame within 20 s")

    run = run_loop(Script(raising))
    case.expect(len(looks) == LoopSettings().blind_looks, "the attempts are bounded", len(looks))
    case.expect(run.end.status == RunStatus.STOPPED, "then the loop stops", run.end.status)
    _nothing_moved(case, run)
    case.reads(run.end.reason, "nothing usable seen", "no frame within 20 s")

    run = run_loop(Script(raising, dark=frozenset(range(1, 9))))
    case.expect(
        run.end.status == RunStatus.STOPPED and run.duration < 100.0,
        "a camera that never answers ends the loop in bounded time",
        (run.end.status, run.duration),
    )
    _nothing_moved(case, run)
    case.reads(run.end.reason, "no camera answered within")

    def once(number: int) -> Capture:
        if number == 1:
            raise OSError("USB disconnected")
        return towel_capture(dc.replace(_TOWEL, ridges=()), seed=case.seed)

    run = run_loop(Script(once))
    case.expect(
        run.end.status == RunStatus.FLAT and run.end.head.number == 2,
        "a single drop-out is looked at again",
        (run.end.status, run.end.head.number),
    )

    seen = _seen(case.seed)
    left = HeadImage(1, seen.pair.left, seen.gaze, 1.0)
    for right in (HeadImage(1, None, seen.gaze, 1.0, "it timed out"), HeadImage(0)):
        found = _perceive(left, right)
        case.expect(found.range_map is None, "one eye alone gives no map")
        case.reads(found.reason, "right camera" if right.number else "no look was taken")


def out_of_step(case: Case) -> None:
    """V2: stereo pair out of sync or swapped."""
    seen = _seen(case.seed)
    good = _perceive(
        HeadImage(1, seen.pair.left, seen.gaze, 1.0), HeadImage(1, seen.pair.right, seen.gaze, 1.0)
    )
    case.need(good.range_map is not None, "the pair as it was taken gives a map", good.reason)

    swapped = _perceive(
        HeadImage(1, seen.pair.right, seen.gaze, 1.0), HeadImage(1, seen.pair.left, seen.gaze, 1.0)
    )
    case.expect(swapped.range_map is None, "swapped eyes give no map")
    case.reads(swapped.reason, "swapped")

    numbers = _perceive(
        HeadImage(2, seen.pair.left, seen.gaze, 1.0), HeadImage(1, seen.pair.right, seen.gaze, 1.0)
    )
    case.expect(numbers.range_map is None, "answers to different looks give no map")
    case.reads(numbers.reason, "different looks")

    stamps = _perceive(
        HeadImage(1, seen.pair.left, seen.gaze, 1.0), HeadImage(1, seen.pair.right, seen.gaze, 31.0)
    )
    case.expect(stamps.range_map is None, "pictures taken 30 s apart give no map", "a map")
    case.reads(stamps.reason, " s apart")

    turned = dc.replace(seen.gaze, right_pan=seen.gaze.right_pan + 0.006)
    gazes = _perceive(
        HeadImage(1, seen.pair.left, seen.gaze, 1.0), HeadImage(1, seen.pair.right, turned, 1.0)
    )
    case.expect(
        gazes.range_map is None,
        "eyes that report different angles for one look give no map",
        "a map",
    )

    case.reads(gazes.reason)

    moved = _seen(case.seed, 0.03)
    shifted = _perceive(
        HeadImage(1, seen.pair.left, seen.gaze, 1.0), HeadImage(1, moved.pair.right, seen.gaze, 1.0)
    )
    if shifted.range_map is not None:
        # The table agrees; the cloth has moved between the exposures, and its heights are wrong.
        case.expect(False, "a cloth that moved 30 mm between the exposures gives no map", "a map")
    else:
        case.reads(shifted.reason)


def spoiled_depth(case: Case) -> None:
    """V3: NaN, zero, saturated depth, holes."""
    rng = case.rng
    good = towel_capture(_TOWEL, seed=case.seed)

    def with_depth(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[int], Capture]:
        def look(number: int) -> Capture:
            return dc.replace(good, depth=change(good.depth.copy()))

        return look

    def holes(share: float, value: float) -> Callable[[np.ndarray], np.ndarray]:
        def change(depth: np.ndarray) -> np.ndarray:
            depth[rng.uniform(size=depth.shape) < share] = value
            return depth

        return change

    for name, look, words in (
        ("all NaN", with_depth(lambda d: d * np.nan), ("all NaN",)),
        ("all zero", with_depth(lambda d: 0 * d), ("all zero",)),
        ("all saturated", with_depth(lambda d: d * 0 + 65.535), ("beyond 10 m",)),
        ("millimetres for metres", with_depth(lambda d: 1e3 * d), ("beyond 10 m",)),
        ("70 % holes", with_depth(holes(0.7, 0.0)), ("insufficient view",)),
        ("70 % NaN", with_depth(holes(0.7, np.nan)), ("insufficient view",)),
    ):
        run = run_loop(Script(look))
        case.expect(run.end.status == RunStatus.STOPPED, f"{name}: no action", run.end.status)
        _nothing_moved(case, run)
        case.reads(run.end.reason, *words)
    for name, value in (("zero", 0.0), ("NaN", np.nan), ("infinite", np.inf)):
        spoiled = dc.replace(good, depth=holes(0.3, value)(good.depth.copy()))
        analysis = analyse(
            range_map_from_capture(
                spoiled, seed=case.seed, centre=GARMENT_CENTRE, table_height=TABLE.height
            ),
            table=TABLE,
        )
        worth = len(Observation.of(analysis).features.worth_pulling(LoopSettings()))
        case.expect(
            worth == 1 and np.isfinite(analysis.range_map.height).all(),
            f"30 % {name} readings are masked, and the wrinkle is found",
            worth,
        )


def _analysed(capture: Capture) -> Analysis:
    return analyse(
        range_map_from_capture(capture, centre=GARMENT_CENTRE, table_height=TABLE.height),
        table=TABLE,
    )


def nothing_to_grasp(case: Case) -> None:
    """V4: empty table, full table, cloth off the edge."""
    cell = depth_cell()
    for name, towel, words in (
        ("empty table", dc.replace(_TOWEL, ridges=(), thickness=0.0), ("no garment",)),
        ("full table", dc.replace(_TOWEL, ridges=(), side=1.9), ("no garment",)),
    ):

        def look(number: int, towel: Towel = towel) -> Capture:
            return towel_capture(towel, seed=case.seed + number)

        run = run_loop(Script(look), cell=cell)
        case.expect(run.end.status == RunStatus.STOPPED, f"{name}: the loop stops", run.end.status)
        _nothing_moved(case, run)
        case.reads(run.end.reason, *words)

    # Masks of a garment of which much lies beyond the table.
    x, y = np.meshgrid(np.arange(0.05, 0.85, 0.002), np.arange(-1.4, -0.8, 0.002))
    hanging = Towel((Ridge((0.46, -1.1), 1.3, 0.021, 0.0125, 0.3),), (0.46, -1.1), side=0.44)
    seen = RangeMap(
        height=hanging.height(x, y).astype(np.float32),
        valid=np.ones(x.shape, bool),
        garment=hanging.edge_distance(x, y) > 0.0,
        resolution=0.002,
        origin=np.array([0.05, -1.4]),
        table_height=0.7,
        sensor="stereo",
    )
    analysis = analyse(seen, table=TABLE)
    decision = policy.decide(
        Observation.of(analysis).features, policy.PolicyState(looks=1), LoopSettings()
    )
    case.expect(
        isinstance(decision, policy.Stop) and not decision.flat,
        "a garment that lies mostly beyond the edge is not worked on",
        decision,
    )
    case.reads(decision.reason if isinstance(decision, policy.Stop) else "", "beyond the table")
    targets = [analysis.target_for(index) for index in range(len(analysis.wrinkles))]
    half = 0.5 * np.array(analysis.table.size)
    outside = [
        hand.p_WG
        for target in targets
        if isinstance(target, FlatteningTarget)
        for hand in target.hands
        if (np.abs(hand.p_WG[:2] - analysis.table.centre) > half).any()
    ]
    case.expect(not outside, "no grasp point lies beyond the table's edge", outside)

    for name, centre, ridge in (("half over the edge", 0.35, 0.30), ("mostly over it", 0.48, 0.37)):

        def over(number: int, centre: float = centre, ridge: float = ridge) -> Capture:
            towel = Towel(
                (Ridge((ridge, -1.1), 1.57, 0.021, 0.0125, 0.25),),
                (centre, -1.1),
                side=0.4,
                thickness=0.004,
            )
            return towel_capture(towel, seed=number, x=0.3)

        run = run_loop(Script(over), cell=cell)
        _nothing_moved(case, run)
        case.expect(
            run.end.status == RunStatus.STOPPED,
            f"a garment {name} is not called flat",
            f"{run.end.status}: {run.end.reason}",
        )
        case.reads(run.end.reason)


def already_flat(case: Case) -> None:
    """V5: already flat cloth."""
    pulled = 0
    for thickness in _LAYERS:
        for seed in range(case.seed, case.seed + _SEEDS):
            flat = Towel((), _CENTRE, thickness=thickness, seed=seed)
            found = Observation.of(_analysed(towel_capture(flat, sigma=0.0003, seed=seed)))
            decision = policy.decide(found.features, policy.PolicyState(looks=1), LoopSettings())
            pulled += isinstance(decision, policy.PullDecision)
    total = len(_LAYERS) * _SEEDS
    case.expect(pulled == 0, f"{total} flat towels with noise: {pulled} false wrinkles", pulled)
    run = run_loop(
        Script(lambda n: towel_capture(dc.replace(_TOWEL, ridges=()), sigma=0.0003, seed=n))
    )
    case.expect(run.end.status == RunStatus.FLAT, "the loop calls it flat", run.end.status)
    _nothing_moved(case, run)
    case.reads(run.end.reason, "flat")


FAULTS = (
    Fault(
        "V1",
        "camera drop-out, time-out, one of two cameras",
        "a camera that raises, never answers, fails once; one eye without a picture",
        "retry bounded, then 'no view' with robot parked",
        drop_out,
    ),
    Fault(
        "V2",
        "stereo pair out of sync or swapped",
        "eyes swapped, of different looks, 30 s apart, at other angles, cloth moved in between",
        "rejected by epipolar or stamp check",
        out_of_step,
    ),
    Fault(
        "V3",
        "NaN, zero, saturated depth, holes",
        "nine spoiled depth images in the whole loop",
        "masked; below a valid-pixel quota -> 'insufficient view', no action",
        spoiled_depth,
    ),
    Fault(
        "V4",
        "empty table, full table, cloth off the edge",
        "synthetic tables, masks and hanging garments",
        "'no garment' / 'garment outside workspace'; never a grasp point",
        nothing_to_grasp,
    ),
    Fault(
        "V5",
        "already flat cloth",
        "8 flat towels with the sensor's noise",
        "zero actions (detector false-positive rate reported)",
        already_flat,
    ),
)
