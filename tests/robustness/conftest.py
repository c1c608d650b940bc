"""The seed of the faults, and their results in pytest's report."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for the seed; only where this folder is named on the command line."""
    parser.addoption("--fault-seed", type=int, default=0, help="seed of the faults' choices")


@pytest.fixture
def fault_seed(request: pytest.FixtureRequest) -> int:
    """The seed of every random choice in a fault."""
    return int(request.config.getoption("--fault-seed", 0))
