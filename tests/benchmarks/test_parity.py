"""One plan in three forms: the small sample keeps the targets, and the page says so."""

import pytest

from benchmarks.parity import benchmark as parity

pytestmark = pytest.mark.alone


# In the suite, test_flatten_forms compares the forms.
@pytest.mark.long
def test_the_forms_agree() -> None:
    results = parity.run(quick=True, seed=0, progress=lambda done, total, stage: None)
    assert max(joint.max for joint in results.loopback.joints) < 0.5e-3
    assert max(joint.max for joint in results.log.joints) < 0.5e-3
    for form in ("sim", "loopback"):
        assert getattr(results.against_plan, form).grip_distance_error < 3e-3
        assert getattr(results.against_plan, form).violations == ()
    assert results.cloth.in_phase.worst < 2e-3
    assert results.held and results.points > 300
    page = parity.table(results)
    assert "0.5 mrad" in page and all(axis in page for axis in results.axes)
