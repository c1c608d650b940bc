"""Files of calibrations and head angles: round trips and refused input."""

import dataclasses
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import (
    HeadAngles,
    HeadCalibration,
    load_calibration,
    load_head_angles,
    nominal_calibration,
    nominal_head,
)

GAZE = Gaze(0.1, -0.2, -0.05, -0.25, 0.3)


def written(folder: Path, calibration: HeadCalibration, day: date = date(2026, 11, 22)) -> Path:
    calibration.save(folder / "calibration.yaml")
    HeadAngles.of(GAZE, nominal_calibration(), "calibration.yaml", day).save(folder / "head.yaml")
    return folder / "head.yaml"


def test_a_look_and_its_calibration_survive_the_files(tmp_path: Path) -> None:
    look, calibration = load_head_angles(written(tmp_path, nominal_calibration()))
    assert look.gaze == GAZE
    assert calibration == nominal_calibration()
    again, nominal = calibration.stereo_head().poses(GAZE), nominal_head().poses(GAZE)
    np.testing.assert_array_equal(again, nominal)


def test_a_date_without_quotes_gets_a_hint(tmp_path: Path) -> None:
    path = written(tmp_path, nominal_calibration())
    path.write_text(path.read_text().replace("'", ""))
    with pytest.raises(InputError, match=r"key date; put it in quotes"):
        load_head_angles(path)


def test_a_head_goes_into_a_calibration_and_out_again() -> None:
    head = nominal_head()
    moved = head.left.X_MC.copy()
    moved[0, 3] += 0.01
    changed = dataclasses.replace(head, left=dataclasses.replace(head.left, X_MC=moved))
    found = nominal_calibration().with_head(changed).stereo_head()
    np.testing.assert_array_equal(found.left.X_MC, moved)
    np.testing.assert_array_equal(found.right.X_RB, head.right.X_RB)


def test_another_heads_calibration_is_refused(tmp_path: Path) -> None:
    other = dataclasses.replace(nominal_calibration(), head="prague")
    with pytest.raises(InputError, match=r"of head 'clopema', .* calibrates 'prague'"):
        load_head_angles(written(tmp_path, other))


def test_a_stale_calibration_is_refused(tmp_path: Path) -> None:
    old = dataclasses.replace(nominal_calibration(), date="2026-01-01", valid_days=180)
    with pytest.raises(InputError, match=r"was 325 days old .* at most 180; calibrate again"):
        load_head_angles(written(tmp_path, old))


def test_an_absent_calibration_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, nominal_calibration())
    (tmp_path / "calibration.yaml").unlink()
    with pytest.raises(InputError, match="no such calibration"):
        load_head_angles(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pan: 0.1", "pan: .nan", "need pan and tilt"),
        ("pan: 0.1", "turn: 0.1", "turn"),
        ("head: clopema", "head: ''", "'head' is missing"),
        ("'2026-11-22'", "soon", "no date"),
    ],
)
def test_looks_that_say_nonsense(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path, nominal_calibration())
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        load_head_angles(path)
    assert "head.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_pose_that_is_no_rotation_is_refused() -> None:
    record = nominal_calibration()
    bent = dataclasses.replace(record.left.base, rotation=[[1.0, 0, 0], [0, 1, 0], [0, 0, 2]])
    spoilt = dataclasses.replace(record, left=dataclasses.replace(record.left, base=bent))
    with pytest.raises(InputError, match="left eye's base: the pose is no rigid motion"):
        spoilt.stereo_head()


def test_nonsense_in_a_camera_names_file_and_camera(tmp_path: Path) -> None:
    path = tmp_path / "calibration.yaml"
    nominal_calibration().save(path)
    path.write_text(path.read_text().replace("fx: 7323.09", "fx: -7323.09"))
    with pytest.raises(InputError, match=r"calibration\.yaml: camera 'left': focal length"):
        load_calibration(path)
