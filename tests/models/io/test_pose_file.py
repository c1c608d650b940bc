"""Pose files of other programs, rounded rotations, and poses that are none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.pose_file import load_pose
from unwrinkle.models.transforms import PoseRecord, check_pose, nearest_pose, pose

P = [0.1, -1.15, 1.7]
R = Rotation.from_euler("xyz", [3.1, 0.05, 0.3])
X = pose(R.as_matrix(), np.array(P))
Q = R.as_quat()
XYZW = dict(zip("xyzw", Q.tolist(), strict=True))
POINT = dict(zip("xyz", P, strict=True))
STAMP = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "world"}


def _written(folder: Path, content: Any) -> Path:
    path = folder / "pose.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


@pytest.mark.parametrize(
    "content",
    [
        {"translation": P, "rotation": R.as_matrix().tolist()},
        {"translation": P, "rotation": R.as_matrix().ravel().tolist()},
        {"translation": P, "quaternion_xyzw": Q.tolist()},
        {"translation": P, "quaternion_wxyz": np.roll(Q, 1).tolist()},
        {"translation": P, "quaternion": XYZW},
        {"position": POINT, "orientation": XYZW},  # geometry_msgs/Pose
        {"header": STAMP, "pose": {"position": POINT, "orientation": XYZW}},
        {"pose": {"pose": {"position": POINT, "orientation": XYZW}, "covariance": [0.0] * 36}},
        {"translation": POINT, "rotation": XYZW},  # geometry_msgs/Transform
        {
            "header": STAMP,
            "child_frame_id": "camera_optical",
            "transform": {"translation": POINT, "rotation": XYZW},
        },
        {"translation": P, "rotation_vector": R.as_rotvec().tolist()},
        {"translation": P, "rpy": R.as_euler("xyz").tolist()},
        {"translation": P, "rpy_degrees": R.as_euler("xyz", degrees=True).tolist()},
        {"matrix": X.tolist()},
        {"X_WC": X[:3].tolist()},
        X.tolist(),
        X.ravel().tolist(),
    ],
)
def test_one_pose_in_many_forms(tmp_path: Path, content: Any) -> None:
    np.testing.assert_allclose(load_pose(_written(tmp_path, content)), X, atol=1e-12)


@pytest.mark.parametrize("label", ["in Quaternion", "in Quaternion (xyzw)"])
def test_what_tf2_echo_prints(tmp_path: Path, label: str) -> None:
    numbers = ", ".join(f"{value:.3f}" for value in Q)
    text = (
        f"At time 12.5\n- Translation: [0.100, -1.150, 1.700]\n- Rotation: {label} [{numbers}]\n"
        "- Rotation: in RPY (radian) [3.1, 0.050, 0.300]\n- Matrix:\n -0.9 0.1 0.2 0.3\n"
    )
    np.testing.assert_allclose(load_pose(_written(tmp_path, text)), X, atol=2e-3)


@pytest.mark.parametrize(("digits", "tolerance"), [(3, 1e-3), (4, 1e-4), (6, 1e-6)])
def test_a_rounded_rotation_becomes_the_nearest_one(
    tmp_path: Path, digits: int, tolerance: float
) -> None:
    rounded = {"translation": P, "rotation": np.round(X[:3, :3], digits).tolist()}
    read = load_pose(_written(tmp_path, rounded))
    check_pose(read, "read")
    np.testing.assert_allclose(read, X, atol=tolerance)
    record = PoseRecord(P, np.round(X[:3, :3], digits).tolist())
    np.testing.assert_allclose(record.matrix("record"), read, atol=1e-12)


def test_an_exact_pose_keeps_its_bits() -> None:
    assert nearest_pose(X, "X") is X


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({"translation": P, "rotation": Q.tolist()}, "quaternion_xyzw"),
        ({"translation": [100.0, -1150.0, 1700.0], "quaternion": XYZW}, "millimetres"),
        ({"translation": [10.0, -115.0, 170.0], "quaternion": XYZW}, "metres"),
        ([[*row[:3], 1000.0 * row[3]] for row in X[:3].tolist()], "millimetres"),
        ({"translation": P, "quaternion_xyzw": [0.0, 0.9, 0.0, 0.0]}, "length 0.9"),
        ({"translation": P, "rotation": np.round(X[:3, :3], 1).tolist()}, "four decimals"),
        ({"translation": P, "rotation": (X[:3, :3] * [1, 1, -1]).tolist()}, "mirrors"),
        ({"translation": P, "rpy": [180.0, 0.0, 17.0]}, "radians"),
        ({"translation": P, "rotation": [3.1, 0.0, 0.3]}, "rotation_vector"),
        ({"translation": P}, "one rotation"),
        ({"translation": P, "rotation": R.as_matrix().tolist(), "rpy": [0, 0, 0]}, "one rotation"),
        ({"translation": P, "rotatoin": R.as_matrix().tolist()}, "rotatoin"),
        ({"translation": P[:2], "quaternion": XYZW}, "in metres"),
        ({"translation": ["a", 1, 2], "quaternion": XYZW}, "no numbers"),
        ({"translation": P, "quaternion": {"x": 0, "y": 1, "z": 0}}, "needs x, y, z, w"),
        ([0.1, -1.1, 1.7, 3.1, 0.0, 0.0], "unknown convention"),
        (X.T.tolist(), "transposed"),
        ([[1, 2], [3, 4]], "4 numbers"),
        ("translation: [0, 0, 1]\ntranslation: [0, 0, 2]\n", "twice"),
        ("a: [1", "line"),
        ("", "empty"),
        (
            {
                "header": {"frame_id": "camera_optical"},
                "child_frame_id": "world",
                "transform": {"translation": POINT, "rotation": XYZW},
            },
            "inverse",
        ),
    ],
)
def test_what_is_no_pose_names_the_cure(tmp_path: Path, content: Any, named: str) -> None:
    with pytest.raises(InputError) as caught:
        load_pose(_written(tmp_path, content))
    assert named in str(caught.value)
    assert "pose.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_records_in_millimetres_are_refused() -> None:
    with pytest.raises(InputError, match="millimetres"):
        PoseRecord([888.0, -268.0, 650.0], np.eye(3).tolist()).matrix("gen_00.png")
