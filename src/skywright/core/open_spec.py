"""Tables whose class depends on their key `kind`: built in, in a user's file, or installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from pydantic import ModelWrapValidatorHandler, model_validator

from skywright.core.find import find
from skywright.core.spec import Spec
from skywright.core.user_files import is_user_module
from skywright.errors import InputError


class OpenSpec(Spec):
    """A table of a `group` (core/find.py): the class of its `kind` validates it."""

    group: ClassVar[str]
    kind: str

    @classmethod
    def find_class(cls, table: object) -> type[Spec]:
        """Return the class of a table, or this one if its kind is invalid."""
        try:
            found = find(cls.group, table["kind"]).cls if isinstance(table, Mapping) else cls
        except (InputError, KeyError):  # the validation reports an invalid kind
            return cls
        return found if issubclass(found, cls) else cls

    def __reduce__(self) -> Any:
        """Pickle the class of a user's file by its kind: another process loads the file first."""
        if not is_user_module(type(self).__module__):
            return super().__reduce__()
        return _revive, (self.group, self.kind, self.model_dump(exclude_unset=True))

    @model_validator(mode="wrap")
    @classmethod
    def _is_of_its_kind(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(data, Mapping) or ("kind" not in data and _names_itself(cls)):
            return handler(data)
        try:
            found = find(cls.group, data.get("kind"))
        except InputError as error:
            raise ValueError(str(error)) from None
        if found.cls is cls:
            return handler({**data, "kind": found.name})
        if not issubclass(found.cls, cls):
            raise ValueError(f"kind: {found.name!r} is not a {cls.__name__}")
        return found.cls.model_validate({**data, "kind": found.name})


def _revive(group: str, kind: str, values: dict[str, Any]) -> OpenSpec:
    spec: OpenSpec = find(group, kind).cls.model_validate(values)
    return spec


def _names_itself(cls: type[OpenSpec]) -> bool:
    return not cls.model_fields["kind"].is_required()
