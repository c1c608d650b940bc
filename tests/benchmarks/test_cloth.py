"""The benchmark of the cloth: its closed forms hold, its page says what it measured."""

import pytest

from benchmarks.cloth import closed_forms, rest


def test_the_cloth_agrees_with_the_closed_forms() -> None:
    checks = closed_forms.run_checks()
    limits = {"cantilever": 0.04, "stretch": 0.01, "shear": 0.04, "sag": 0.01, "incline": 0.01}
    for name, limit in limits.items():
        for row in getattr(checks, name):
            assert abs(row.error) < limit, (name, row)


def test_the_closed_form_of_a_cantilever_is_peirces_for_a_stiff_strip() -> None:
    # B / weight = 3e-4 / 3.43: the elastica's bending length is within 2 % of its cube root.
    row = closed_forms.cantilever(
        closed_forms.load_material("terry").changed(bending=3e-4, plastic_bending=0.0), 0.081
    )
    assert row.bending_length_exact == pytest.approx(row.bending_length_material, rel=0.02)


def test_one_process_repeats_itself() -> None:
    assert rest.fingerprint(24, 0) == rest.fingerprint(24, 0)
    assert rest.fingerprint(24, 0) != rest.fingerprint(24, 1)
