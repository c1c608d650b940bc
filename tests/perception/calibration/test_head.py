"""Head calibration: recover a head that differs from the nominal one from corners alone."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.calibration.head import HeadFit, HeadView, calibrate_head
from unwrinkle.perception.calibration.stereo import StereoCalibration, calibrate_stereo
from unwrinkle.perception.stereo.head import Eye, Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.testing.calibration_scene import BOARD, BoardScene, corners_of, true_head

NOMINAL = nominal_calibration()


@dataclasses.dataclass
class Case:
    """A true head, what was seen of boards, and the stereo calibration."""

    truth: StereoHead
    looks: list[HeadView]
    stereo: StereoCalibration


@pytest.fixture(scope="module")
def case() -> Case:
    rng = np.random.default_rng(3)
    truth = true_head(NOMINAL.stereo_head(), rng)
    scene = BoardScene(truth, corners_of(truth, BOARD, 0.04, rng), rng, 16, 18)
    stereo = calibrate_stereo(scene.pairs(), BOARD).calibration
    looks = [
        HeadView(f"look {k}", gaze, *scene.eyes(scene.fixed, truth.poses(gaze)))
        for k, gaze in enumerate(scene.gazes)
    ]
    return Case(truth, looks, stereo)


@pytest.fixture(scope="module")
def fit(case: Case) -> HeadFit:
    return calibrate_head(case.looks, case.stereo, NOMINAL)


def _eyes(head: StereoHead) -> tuple[Eye, Eye]:
    return head.left, head.right


def test_cameras_on_their_mounts_meet_the_target(case: Case, fit: HeadFit) -> None:
    for true, found in zip(_eyes(case.truth), _eyes(fit.calibration.stereo_head()), strict=True):
        assert np.degrees(angle_between(true.X_MC, found.X_MC)) < 0.005
        assert np.linalg.norm(true.X_MC[:3, 3] - found.X_MC[:3, 3]) < 0.0002
        assert found.camera.fx == pytest.approx(true.camera.fx, rel=1e-4)
    assert not fit.rejected


def test_it_is_better_than_tsai_alone(case: Case, fit: HeadFit) -> None:
    found = _eyes(fit.calibration.stereo_head())
    for k, true in enumerate(_eyes(case.truth)):
        alone = angle_between(true.X_MC, fit.hand_eyes[k].X_MC)
        assert angle_between(true.X_MC, found[k].X_MC) < alone < np.radians(0.2)


def test_the_pair_is_known_at_gazes_it_was_not_calibrated_at(case: Case, fit: HeadFit) -> None:
    found = fit.calibration.stereo_head()
    for gaze in (Gaze(0.1, -0.3, -0.1, -0.25), Gaze(-0.2, 0.1, -0.3, 0.05, 0.5)):
        true, mine = case.truth.relative(gaze), found.relative(gaze)
        assert np.degrees(angle_between(true, mine)) < 0.006
        np.testing.assert_allclose(true[:3, 3], mine[:3, 3], atol=3e-4)


def test_the_file_says_what_it_rests_on(case: Case, fit: HeadFit) -> None:
    found = fit.calibration
    assert found.head == NOMINAL.head
    assert found.left.views == found.right.views == 34
    assert found.left.residual == pytest.approx(0.057, rel=0.1)
    assert 0.03 < found.row_residual < 0.1
    assert "18 looks" in found.source
    assert found.valid_days < 400 < NOMINAL.valid_days
    np.testing.assert_array_equal(found.stereo_head().left.X_RB, case.truth.left.X_RB)
    assert len(fit.names) == len(fit.corners) == len(fit.adjustment.residuals) == 68


def test_a_look_with_the_angles_of_another_is_left_out(case: Case) -> None:
    looks = list(case.looks)
    looks[4] = dataclasses.replace(looks[4], gaze=looks[11].gaze)
    found = calibrate_head(looks, case.stereo, NOMINAL)
    assert {reason.split(":")[0] for reason in found.rejected} == {"look 4"}
    _check_close(case, found)


def test_a_small_slip_of_one_unit_is_left_out(case: Case) -> None:
    looks = list(case.looks)
    gaze = looks[9].gaze
    looks[9] = dataclasses.replace(
        looks[9], gaze=dataclasses.replace(gaze, right_pan=gaze.right_pan + 0.001)
    )
    found = calibrate_head(looks, case.stereo, NOMINAL)
    assert len(found.rejected) == 1
    assert found.rejected[0].startswith("look 9: right view has angles off by 0.05")
    _check_close(case, found)


def _check_close(case: Case, fit: HeadFit) -> None:
    for true, found in zip(_eyes(case.truth), _eyes(fit.calibration.stereo_head()), strict=True):
        assert np.degrees(angle_between(true.X_MC, found.X_MC)) < 0.006


def test_a_board_moved_between_the_looks(case: Case) -> None:
    """Two places: the second group is of the stereo views' kind, but at a known gaze."""
    rng = np.random.default_rng(4)
    scene = BoardScene(case.truth, corners_of(case.truth, BOARD, 0.04, rng), rng, 1, 18)
    poses = case.truth.poses(scene.stage)
    pair = scene.eyes(scene.places[0], poses)
    looks = [*case.looks, HeadView("elsewhere", scene.stage, *pair, "elsewhere")]
    found = calibrate_head(looks, case.stereo, NOMINAL)
    assert not found.rejected
    _check_close(case, found)


def _with_gazes(looks: list[HeadView], change: Callable[[Gaze], Gaze]) -> list[HeadView]:
    return [dataclasses.replace(look, gaze=change(look.gaze)) for look in looks]


@pytest.mark.parametrize(
    ("axis", "named"), [("tilt", "left eye: tilt varies by only"), ("pan", "left eye: pan varies")]
)
def test_angles_of_one_axis_only_are_refused(case: Case, axis: str, named: str) -> None:
    def still(gaze: Gaze) -> Gaze:
        held = {f"{side}_{axis}": 0.02 for side in ("left", "right")}
        return dataclasses.replace(gaze, **held)

    with pytest.raises(InputError, match=named):
        calibrate_head(_with_gazes(case.looks, still), case.stereo, NOMINAL)


def test_other_refusals(case: Case) -> None:
    def turned(gaze: Gaze) -> Gaze:
        return dataclasses.replace(gaze, ext_axis=gaze.left_pan)

    def in_degrees(gaze: Gaze) -> Gaze:
        return Gaze(*(np.degrees(a) for a in dataclasses.astuple(gaze)))

    def of_the_other(gaze: Gaze) -> Gaze:
        return Gaze(*gaze.right, *gaze.left)

    looks = case.looks
    for wrong, named in (
        (looks[:7], "7 usable looks of the left eye"),
        (
            [dataclasses.replace(look, right=None) for look in looks],
            "0 usable looks of the right eye",
        ),
        (_with_gazes(looks, turned), "turn-table"),
        (_with_gazes(looks, in_degrees), "radians"),
        (
            [dataclasses.replace(look, gaze=looks[k - 5].gaze) for k, look in enumerate(looks)],
            "usable looks|disagree|do not fit",
        ),
    ):
        with pytest.raises(InputError, match=named):
            calibrate_head(wrong, case.stereo, NOMINAL)


def test_swapped_eyes_are_refused(case: Case) -> None:
    swapped = [
        HeadView(look.name, Gaze(*look.gaze.right, *look.gaze.left), look.right, look.left)
        for look in case.looks
    ]
    stereo = dataclasses.replace(
        case.stereo, left=case.stereo.right, right=case.stereo.left, views=[]
    )
    with pytest.raises(InputError, match="swapped"):
        calibrate_head(swapped, stereo, NOMINAL)


def test_images_of_another_size_are_refused(case: Case) -> None:
    small = dataclasses.replace(case.stereo, left=case.stereo.left.scaled(0.5))
    with pytest.raises(InputError, match="4928 x 3264 pixels, the stereo calibration is for 2464"):
        calibrate_head(case.looks, small, NOMINAL)


@pytest.mark.slow
def test_repeatability_of_the_units_is_reckoned_with(case: Case) -> None:
    """Units that come to rest a quarter of a step off, unknown to whoever reads their angles."""
    rng = np.random.default_rng(5)
    off = 0.25 * case.truth.left.unit.step
    scene = BoardScene(case.truth, corners_of(case.truth, BOARD, 0.04, rng), rng, 1, 18)
    looks = []
    for k, gaze in enumerate(scene.gazes):
        true = Gaze(*(np.array([*gaze.left, *gaze.right]) + off * rng.standard_normal(4)))
        looks.append(HeadView(f"look {k}", gaze, *scene.eyes(scene.fixed, case.truth.poses(true))))
    found, told, exact = (
        calibrate_head(looks, case.stereo, NOMINAL, joint_noise=noise) for noise in (None, off, 0.0)
    )
    assert not found.rejected
    assert found.adjustment.joint_noise == pytest.approx(off, rel=0.4)
    assert found.adjustment.rms < 0.07
    assert exact.adjustment.rms > 0.2
    worst = {}
    for name, fit in (("found", found), ("told", told), ("exact", exact)):
        pairs = zip(_eyes(case.truth), _eyes(fit.calibration.stereo_head()), strict=True)
        worst[name] = max(
            float(np.linalg.norm((inverse(true.X_MC) @ mine.X_MC)[:3, 3])) for true, mine in pairs
        )
    assert worst["found"] < 0.0004
    assert worst["found"] == pytest.approx(worst["told"], abs=5e-5)
    assert worst["found"] < worst["exact"]


def test_exact_units_are_found_to_be_exact(fit: HeadFit) -> None:
    assert fit.adjustment.joint_noise < 1e-5
