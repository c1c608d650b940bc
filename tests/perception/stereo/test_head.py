"""Kinematics of the head against the Drake model, and aiming."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import build_robot_diagram, load_cell, position_indices
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import nominal_head

HEAD = nominal_head()
angle = st.floats(-0.5, 0.5)


def test_frames_are_those_of_the_cells_model() -> None:
    cell = load_cell()
    plant = build_robot_diagram(cell).plant()
    context = plant.CreateDefaultContext()
    indices = position_indices(cell, plant)
    rng = np.random.default_rng(0)
    for _ in range(5):
        gaze = Gaze(*rng.uniform(-0.5, 0.5, 5))
        q = plant.GetPositions(context)
        q[indices.axes[0]] = gaze.ext_axis
        q[indices.head] = [*gaze.left, *gaze.right]
        plant.SetPositions(context, q)
        X_WL, X_WR = HEAD.poses(gaze)
        for name, eye, X_WC in (("left_ptu", HEAD.left, X_WL), ("right_ptu", HEAD.right, X_WR)):
            frame = plant.GetFrameByName("mount", plant.GetModelInstanceByName(name))
            X_WM = frame.CalcPoseInWorld(context).GetAsMatrix4()
            np.testing.assert_allclose(X_WC @ inverse(eye.X_MC), X_WM, atol=1e-9)


def test_limits_are_those_of_the_cell() -> None:
    limits = load_cell().limits.head
    for eye in (HEAD.left, HEAD.right):
        assert eye.unit.pan == (limits.pan.lower, limits.pan.upper)
        assert eye.unit.tilt == (limits.tilt.lower, limits.tilt.upper)


@settings(max_examples=30, deadline=None)
@given(x=st.floats(-0.4, 0.4), y=st.floats(-1.6, -0.8), z=st.floats(0.5, 1.0), ext=angle)
def test_both_axes_pass_through_the_point_gazed_at(
    x: float, y: float, z: float, ext: float
) -> None:
    point = HEAD.turntable_pose(ext)[:3, :3] @ np.array([-y, x, 0.0])
    point[2] = z
    gaze = HEAD.gaze_at(point, ext)
    for X_WC in HEAD.poses(gaze):
        seen = transformed(inverse(X_WC), point)
        assert seen[2] > 1.0
        np.testing.assert_allclose(seen[:2], 0.0, atol=1e-8)


@settings(max_examples=20, deadline=None)
@given(lp=angle, lt=angle, rp=angle, rt=angle, ext=angle)
def test_the_pairs_relative_pose_does_not_depend_on_the_turntable(
    lp: float, lt: float, rp: float, rt: float, ext: float
) -> None:
    still, turned = (HEAD.relative(Gaze(lp, lt, rp, rt, e)) for e in (0.0, ext))
    np.testing.assert_allclose(still, turned, atol=1e-12)


def test_cameras_see_the_working_table_upright() -> None:
    X_WL, X_WR = HEAD.poses(HEAD.gaze_at(np.array([0.0, -1.1, 0.7])))
    for X_WC in (X_WL, X_WR):
        assert X_WC[2, 2] < -0.6  # it looks down
        assert X_WC[0, 0] < -0.9  # its image's right is the robot's right, -x
        assert X_WC[2, 1] < 0.0  # its image's down is down
    assert X_WL[0, 3] > X_WR[0, 3]
    assert HEAD.relative(HEAD.gaze_at(np.array([0.0, -1.1, 0.7])))[0, 3] > 0.2


def test_angles_beyond_the_limits_are_refused() -> None:
    with pytest.raises(InputError, match=r"left eye: tilt 0\.7000 rad is beyond .* by 0\.18"):
        HEAD.poses(Gaze(left_tilt=0.7))
    with pytest.raises(InputError, match="right eye: pan -3"):
        HEAD.poses(Gaze(right_pan=-3.0))
    with pytest.raises(InputError, match="not finite"):
        HEAD.poses(Gaze(ext_axis=float("nan")))


def test_what_is_out_of_reach_is_not_gazed_at() -> None:
    with pytest.raises(InputError, match="tilt"):
        HEAD.gaze_at(np.array([0.0, 0.3, 0.0]))
    with pytest.raises(InputError):
        HEAD.gaze_at(HEAD.poses(Gaze())[0][:3, 3])
