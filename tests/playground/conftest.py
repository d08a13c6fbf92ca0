import pytest

from sb3_guide.playground.cast import Cast


@pytest.fixture(scope="session")
def cast() -> Cast:
    """The shipped agents; each is loaded once."""
    return Cast()
