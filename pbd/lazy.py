"""A property that is computed once for each value."""

import functools
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 12):
    from functools import cached_property as cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 (it stands for functools' own)
        """As Python 3.12's. In 3.11 one lock for all values of a class is held while a property is computed.

        Threads wait for each other's values there, and a process that is forked meanwhile waits for ever.
        """

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            if instance is None:
                return self
            value = instance.__dict__[self.attrname] = self.func(instance)
            return value
