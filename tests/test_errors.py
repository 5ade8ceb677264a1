"""Errors cross to other processes: a pool of workers breaks at one that cannot be unpickled."""

import pickle

import pytest

from skywright.errors import InfeasibleError, InputError, SimulationError


@pytest.mark.parametrize(
    "error", [InputError("a"), SimulationError("b"), InfeasibleError("no path", "shape 0")]
)
def test_an_error_is_the_same_after_pickling(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error) and str(copy) == str(error)
    assert copy.__dict__ == error.__dict__
