"""Reading a small YAML file that somebody else may have written."""

from __future__ import annotations

import reprlib
from pathlib import Path
from typing import Any

import yaml

from hqpipe.errors import LogError

_LARGEST = 1 << 22  # bytes; about 40,000 trials, and seconds to parse

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxstring, _SHORT.maxother = 2, 4, 4, 60, 60


def shown(value: Any) -> str:
    """A value for a message: short, whatever it is. Aliases in a YAML file can make a value endless when it is written out."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number that is too long"


class _Loader(yaml.SafeLoader):
    """Plain data only, and no field twice: which one counts would depend on the parser."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:merge" and (name := getattr(key, "value", None)) and isinstance(name, str):
                if name in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the field '{name}' is there twice", key.start_mark
                    )
                seen.add(name)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> Any:
    """The content of a YAML file.

    Raises:
        LogError: it cannot be read, is too large or nested too deep, or is no YAML.
    """
    fix = "correct the file there"
    try:
        if not path.is_file():
            what = "is a folder" if path.is_dir() else "is no file, or a broken link"
            raise LogError(f"{path}: {what}, expected a YAML file", file=path, fix="remove it, or write the file")
        if (size := path.stat().st_size) > _LARGEST:
            raise LogError(f"{path}: {size} bytes, expected at most {_LARGEST}", file=path, fix="split the log set")
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except UnicodeDecodeError as error:
        reason, fix = f"byte {error.start} is not UTF-8", "save the file as UTF-8"
    except RecursionError:
        reason = "it is nested too deep"
    except OSError as error:
        raise LogError(
            f"{path}: cannot be read ({error.strerror})", file=path, fix="correct its permissions"
        ) from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a date or a number that is none
        reason = " ".join(str(error).split())[:300]
    raise LogError(f"{path}: not YAML: {reason}", file=path, fix=fix)
