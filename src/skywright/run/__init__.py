# One execution of a mission: planning, flight, evaluation and its directory.
#
# Importing this package sets the attribute `run` of `skywright`, which is also a function of the
# public API. The package is therefore callable, with the documentation, signature and type hints of
# that function: `skywright.run(description)` flies, and `help(skywright.run)` describes the
# arguments, in either case.

import inspect
import os
import sys
from types import ModuleType
from typing import Any, get_type_hints

_api = sys.modules["skywright"]
_function = _api.run
__doc__ = _function.__doc__
__signature__ = inspect.signature(_function)


class _Package(ModuleType):
    __call__ = staticmethod(_function)

    @property
    def __annotations__(self) -> dict[str, Any]:  # type: ignore[override]
        """The types themselves: their modules are imported only on request."""
        types = {name: getattr(_api, name) for name in ("Description", "Live", "RunResult")}
        return get_type_hints(_function, localns={"os": os, **types})


sys.modules[__name__].__class__ = _Package
