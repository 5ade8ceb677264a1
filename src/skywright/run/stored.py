"""Files that a run or a campaign wrote and a user may have edited: parsed by type."""

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from skywright.core.toml_files import describe_value

SHOWN = 120  # characters of a found value, in a message


class Stored(BaseModel):
    """Base class for the content of a file; unknown keys are ignored."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    @classmethod
    def read(cls, value: Any) -> Self:
        """Parse JSON data; raises ValueError that names the first invalid value."""
        try:
            return cls.model_validate(value)
        except ValidationError as error:
            item = error.errors(include_url=False)[0]
            where = ".".join(map(str, item["loc"]))[:SHOWN] or "the file's content"
            found = describe_value(item["input"])[:SHOWN]
            says = str(item["msg"]).removeprefix("Input should be ")
            if item["type"] in ("model_type", "dict_type"):
                says = "a JSON object"
            raise ValueError(f"{where}: found {found}; valid: {says}") from None
