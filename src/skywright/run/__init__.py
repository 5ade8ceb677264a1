"""One execution of a mission: planning, flight, evaluation and its directory.

Importing this package sets the attribute `run` of `skywright`, which is also a function of the
public API. The package is therefore callable: `skywright.run(description)` flies in either case.
"""

import sys
from types import ModuleType


class _Package(ModuleType):
    __call__ = staticmethod(sys.modules["skywright"].run)


sys.modules[__name__].__class__ = _Package
