"""Plan files that are damaged or made to mislead: each is refused at once, with one sentence."""

import dataclasses as dc
import io
import json
import re
import struct
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan, GarmentSurface
from unwrinkle.planning.search.planner import FlatteningPlanner

Header = dict[str, Any]


@pytest.fixture(scope="module")
def plan(
    planner: FlatteningPlanner, make_target: Callable[..., FlatteningTarget]
) -> FlatteningPlan:
    result = planner.plan(make_target(phi=0.3))
    assert result.plan is not None
    return result.plan


@pytest.fixture(scope="module")
def members(plan: FlatteningPlan, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The members of a good plan's file, by name."""
    path = tmp_path_factory.mktemp("good") / "plan.npz"
    plan.save(path)
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def array_bytes(value: object) -> bytes:
    stream = io.BytesIO()
    np.save(stream, value)
    return stream.getvalue()


def written(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def with_header(members: dict[str, bytes], text: str) -> dict[str, bytes]:
    return {**members, "header.npy": array_bytes(np.array(text))}


def edited(members: dict[str, bytes], edit: Callable[[Header], object]) -> dict[str, bytes]:
    """The members with an edit of the header.

    Not of its hash, since a damaged field is found before.
    """
    header = json.loads(str(np.load(io.BytesIO(members["header.npy"]))))
    edit(header)
    return with_header(members, json.dumps(header))


def refused(path: Path) -> str:
    """The one line that a file is refused with, within a second and 200 MB."""
    tracemalloc.start()
    clock = time.perf_counter()
    try:
        with pytest.raises(InputError) as error:
            FlatteningPlan.load(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - clock < 3.0
    assert peak < 200e6
    message = str(error.value)
    assert path.name in message
    assert "\n" not in message and len(message) < 400
    return message


def test_the_members_as_they_are_give_the_plan(
    plan: FlatteningPlan, members: dict[str, bytes], tmp_path: Path
) -> None:
    again = FlatteningPlan.load(written(tmp_path / "plan.npz", members))
    assert again.content_hash == plan.content_hash


EDITS: dict[str, tuple[Callable[[Header], object], str]] = {
    "dwell NaN": (lambda h: h["events"][0].update(dwell=float("nan")), "header"),
    "time NaN": (lambda h: h["events"][0].update(time=float("nan")), "header"),
    "share NaN": (lambda h: h["arms"][0].update(share=float("nan")), "header"),
    "offset infinite": (lambda h: h["arms"][0].update(offset=float("inf")), "header"),
    "tilt infinite": (lambda h: h["arms"][1].update(tilt=float("-inf")), "header"),
    "turntable NaN": (lambda h: h.update(turntable=float("nan")), "header"),
    "start NaN": (lambda h: h["segments"][0].update(start=float("nan")), "header"),
    "contact NaN": (lambda h: h["segments"][0].update(contact=[0.0, float("nan")]), "header"),
    "start text": (lambda h: h["segments"][1].update(start="0.5"), r"segments\[1\]\.start"),
    "speed text": (lambda h: h.update(speed="fast"), "speed"),
    "speed true": (lambda h: h.update(speed=True), "speed"),
    "dwell null": (lambda h: h["events"][1].update(dwell=None), r"events\[1\]\.dwell"),
    "dwell list": (lambda h: h["events"][1].update(dwell=[0.75]), "dwell"),
    "side 0.0": (lambda h: h["arms"][0].update(side=0.0), r"arms\[0\]\.side"),
    "closed words": (lambda h: h["events"][0].update(closed=["yes", "yes"]), "true or false"),
    "closed short": (lambda h: h["events"][0].update(closed=[True]), "closed"),
    "closed none": (lambda h: h["segments"][0].update(closed=[]), "closed"),
    "arms short": (lambda h: h.update(arms=h["arms"][:1]), "arms"),
    "arms none": (lambda h: h.update(arms=[]), "arms"),
    "arm a number": (lambda h: h.update(arms=[1, 2]), r"arms\[0\]"),
    "arm with more": (lambda h: h["arms"][0].update(colour="red"), "colour"),
    "contact short": (lambda h: h["segments"][2].update(contact=[0.0]), "contact"),
    "segments a text": (lambda h: h.update(segments="abc"), "segments"),
    "one segment more": (lambda h: h["segments"].append(h["segments"][0]), "segment3"),
    "eleven segments": (lambda h: h.update(segments=4 * h["segments"]), "segment3"),
    "pose without time": (lambda h: h["segments"][0]["poses"][0].pop("time"), "time"),
    "name a number": (lambda h: h["segments"][0].update(name=7), "name"),
    "note a list": (lambda h: h.update(note=[]), "note"),
    "huge number": (lambda h: h.update(turntable=10**400), "turntable"),
    "target a list": (lambda h: h.update(target=[]), "target"),
    "target's pull a text": (lambda h: h["target"]["hands"][0].update(pull_distance="x"), "target"),
    "target's point null": (lambda h: h["target"]["hands"][0].update(p_WG=None), "target|p_WG"),
    "one hand": (lambda h: h["target"].update(hands=h["target"]["hands"][:1]), "hands"),
    "no events": (lambda h: h.pop("events"), "events"),
}


@pytest.mark.parametrize(("edit", "named"), EDITS.values(), ids=EDITS)
def test_fields_that_are_something_else(
    members: dict[str, bytes], tmp_path: Path, edit: Callable[[Header], object], named: str
) -> None:
    message = refused(written(tmp_path / "spoilt.npz", edited(members, edit)))
    assert re.search(named, message)


HEADERS = {
    "deep": "[" * 100_000,
    "deep object": '{"a":' * 100_000,
    "5000 digits": '{"format": "unwrinkle-plan", "version": ' + "1" * 5000 + "}",
    "beyond float": '{"format": "unwrinkle-plan", "version": 1, "speed": 1e999}',
    "no JSON": "speed: 1",
    "a number": "5",
    "empty": "",
}


@pytest.mark.parametrize("text", HEADERS.values(), ids=HEADERS)
def test_headers_that_are_none(members: dict[str, bytes], tmp_path: Path, text: str) -> None:
    message = refused(written(tmp_path / "spoilt.npz", with_header(members, text)))
    assert "JSON header" in message


def npy(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


ARRAYS = {
    "1e9 rows": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 13), }"),
    "1e18 rows": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000000,), }"),
    "negative": npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 13), }", bytes(104)),
    "objects": npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", b"cos\nsystem\n."),
    "no literal": npy("{'descr': __import__('os'), }"),
    "cut": b"\x93NUMPY",
    "nothing": b"",
    "text": array_bytes(np.full((5, 13), "1.0")),
    "complex": array_bytes(np.zeros((5, 13), complex)),
    "truth": array_bytes(np.zeros((5, 13), bool)),
    "scalar": array_bytes(np.float64(1.0)),
    "infinite": array_bytes(np.full((5, 13), np.inf)),
    "cube": array_bytes(np.zeros((5, 13, 2))),
}


@pytest.mark.parametrize("member", ["times", "velocities"])
@pytest.mark.parametrize("data", ARRAYS.values(), ids=ARRAYS)
def test_arrays_that_are_none(
    members: dict[str, bytes], tmp_path: Path, data: bytes, member: str
) -> None:
    assert refused(written(tmp_path / "spoilt.npz", {**members, f"segment1.{member}.npy": data}))


def test_an_array_that_is_missing(members: dict[str, bytes], tmp_path: Path) -> None:
    fewer = {name: data for name, data in members.items() if name != "segment2.positions.npy"}
    assert "segment2.positions" in refused(written(tmp_path / "spoilt.npz", fewer))


def test_files_that_are_no_archive(members: dict[str, bytes], tmp_path: Path) -> None:
    path = tmp_path / "spoilt.npz"
    for data in (b"", b"P", b"PK", b"PK\x03\x04", b"PK\x03\x04" + bytes(200), bytes(1000)):
        path.write_bytes(data)
        assert "pickle" not in refused(path)
    path.write_bytes(members["segment0.times.npy"])
    assert "bare array" in refused(path)


def test_two_members_of_one_name(members: dict[str, bytes], tmp_path: Path) -> None:
    path = tmp_path / "spoilt.npz"
    written(path, members)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("segment0.times.npy", members["segment1.times.npy"])
    assert "two members" in refused(path)


@pytest.mark.parametrize("spoil", ["encrypted", "compression"])
def test_members_that_cannot_be_unpacked(
    members: dict[str, bytes], tmp_path: Path, spoil: str
) -> None:
    """Flags of the central directory and of the local header.

    Encrypted, or packed in an unknown way.
    """
    path = written(tmp_path / "spoilt.npz", members)
    data = bytearray(path.read_bytes())
    for signature, flags, method in ((b"PK\x03\x04", 6, 8), (b"PK\x01\x02", 8, 10)):
        at = data.find(signature)
        while at >= 0:
            offset, value = (flags, 1) if spoil == "encrypted" else (method, 77)
            data[at + offset : at + offset + 2] = struct.pack("<H", value)
            at = data.find(signature, at + 4)
    path.write_bytes(data)
    assert "damaged" in refused(path)


@pytest.mark.parametrize("name", ["segment0.positions.npy", "header.npy"])
def test_a_member_that_unpacks_without_end(
    members: dict[str, bytes], tmp_path: Path, name: str
) -> None:
    """300 MB of zeros in 300 kB."""
    path = tmp_path / "spoilt.npz"
    rest = {key: data for key, data in members.items() if key != name}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, data in rest.items():
            archive.writestr(key, data)
        with archive.open(name, "w", force_zip64=True) as stream:
            stream.write(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (40000000,), }"))
            for _ in range(300):
                stream.write(bytes(1_000_000))
    assert "MB" in refused(path)


def test_members_that_no_plan_has_are_left_unread(
    plan: FlatteningPlan, members: dict[str, bytes], tmp_path: Path
) -> None:
    more = {**members, "notes.npy": b"no array at all", "segment0.jerk.npy": b"", "x/y": b"z"}
    path = written(tmp_path / "more.npz", more)
    assert FlatteningPlan.load(path).content_hash == plan.content_hash
    with pytest.raises(InputError, match="cannot be read"):
        load_archive(path)


def test_a_garment_of_vertices_that_are_not_there(plan: FlatteningPlan, tmp_path: Path) -> None:
    row = np.zeros((1, 3), np.float32)
    garment = GarmentSurface(
        row, np.array([[0, 1, 2]], np.int32), np.zeros((1, 3), np.uint8), row, row
    )
    path = tmp_path / "plan.npz"
    dc.replace(plan, garment=garment).save(path)
    assert "vertices" in refused(path)


def test_whole_numbers_written_as_such_keep_the_hash(plan: FlatteningPlan, tmp_path: Path) -> None:
    """A dwell of 1 and one of 1.0 are one plan."""
    events = (dc.replace(plan.events[0], dwell=1), plan.events[1])
    whole = dc.replace(plan, events=events)
    whole.save(tmp_path / "plan.npz")
    again = FlatteningPlan.load(tmp_path / "plan.npz")
    assert again.content_hash == whole.content_hash
    assert again.events[0].dwell == 1.0
