"""Findings and verdicts as values."""

import pytest

from unwrinkle.planning.verification.verdict import (
    Check,
    Findings,
    PairClearance,
    Verdict,
    Violation,
)


def verdict(**changes: object) -> Verdict:
    fields: dict[str, object] = {
        "plan_hash": "p" * 64,
        "robot_hash": "r",
        "limits_hash": "l",
        "checks": (),
        "violations": (),
        "clearances": (),
        "elsewhere": 0.25,
        "queries": 7,
    }
    return Verdict(**{**fields, **changes})


def pair(kind: str, distance: float) -> PairClearance:
    return PairClearance((kind, "table"), kind, distance, 1.5, distance - 0.01, 0.02, 0.03)


def test_of_several_checks_of_one_name_the_least_margin_counts() -> None:
    found = Findings()
    for margin in (0.3, -0.2, 0.1):
        found.check("tilt", 1.0, 1.0 + margin, margin, "rad", f"{margin}", 2.0)
    assert found.checks() == (Check("tilt", True, 1.0, 0.8, -0.2, "rad", "-0.2", 2.0),)
    equal = Findings()
    equal.check("tilt", margin=0.1, where="first")
    equal.check("tilt", margin=0.1, where="second")
    assert equal.checks()[0].where == "first"


def test_a_check_without_a_margin_counts_as_at_its_limit() -> None:
    for margin, kept in ((0.1, None), (-0.1, -0.1)):
        found = Findings()
        found.check("hash", where="none")
        found.check("hash", margin=margin)
        assert found.checks()[0].margin == kept
        found = Findings()
        found.check("hash", margin=margin)
        found.check("hash")
        assert found.checks()[0].margin == (None if margin > 0.0 else margin)


def test_checks_come_in_the_order_of_the_table_with_violations_among_them() -> None:
    found = Findings()
    found.check("roll", 1.0, 2.0, 1.0, "rad", "right", 3.0)
    found.fail("hash", "other hash")
    found.check("speed", 0.5)
    found.fail("roll", "rolled", 4.0)
    assert found.checks() == (
        Check("hash", False),
        Check("speed", True, 0.5),
        Check("roll", False, 1.0, 2.0, 1.0, "rad", "right", 3.0),
    )
    assert found.violations == [Violation("hash", "other hash"), Violation("roll", "rolled", 4.0)]
    assert found.failed("hash") and found.failed("tilt", "roll") and not found.failed("speed")
    with pytest.raises(KeyError):
        found.fail("mood", "no such check")


def test_the_smallest_clearance_is_of_bodies_that_must_not_touch() -> None:
    pairs = (
        pair("adjacent", 0.001),
        pair("self", 0.002),
        pair("finger-table", 0.0),
        pair("arm-table", 0.05),
        pair("arm-arm", 0.04),
    )
    assert verdict(clearances=pairs).smallest == pairs[4]
    assert verdict(clearances=pairs[:3]).smallest is None
    assert verdict().passed and not verdict(violations=(Violation("hash", "x"),)).passed


def test_a_verdict_as_plain_values() -> None:
    check = Check("tilt", False, 1.0, 0.8, -0.2, "rad", "right tool", 2.0)
    near = pair("arm-arm", 0.04)
    data = verdict(
        checks=(check,), violations=(Violation("tilt", "tilted", 2.0),), clearances=(near,)
    ).to_json()
    flat = {"bodies": ("arm-arm", "table"), "kind": "arm-arm", "distance": 0.04, "time": 1.5}
    flat |= {"bound": pytest.approx(0.03), "required": 0.02, "margin": 0.03}
    assert data == {
        "passed": False,
        "plan_hash": "p" * 64,
        "robot_hash": "r",
        "limits_hash": "l",
        "violations": [{"kind": "tilt", "message": "tilted", "time": 2.0}],
        "checks": [
            {
                "name": "tilt",
                "passed": False,
                "value": 1.0,
                "limit": 0.8,
                "margin": -0.2,
                "unit": "rad",
                "where": "right tool",
                "time": 2.0,
            }
        ],
        "smallest_clearance": flat,
        "clearances": [flat],
        "elsewhere": 0.25,
        "queries": 7,
    }
    assert verdict().to_json()["smallest_clearance"] is None
    assert verdict(checks=(check,)).check("tilt") is check
    with pytest.raises(KeyError):
        verdict(checks=(check,)).check("roll")
