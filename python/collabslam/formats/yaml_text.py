"""The one place that parses YAML: no code is run, and nothing is built that is far larger than the text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import yaml

MOST_CHARACTERS = 1 << 20
MOST_VALUES = 100_000
"""Values in the tree, those that aliases repeat counted each time."""


class _Loader(yaml.SafeLoader):
    """Builds plain types; a key that stands twice is a fault, where YAML keeps the last one."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        once((self.construct_object(key, deep=True), None) for key, _ in node.value)
        return super().construct_mapping(node, deep)


def once(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """A dictionary of pairs; raises ValueError if a key comes twice."""
    out: dict[Any, Any] = {}
    for key, value in pairs:
        if key in out and key != "<<":
            raise ValueError(f"the key '{key}' stands twice")
        out[key] = value
    return out


def load_yaml(text: str) -> Any:
    """The content of a YAML text in plain types.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, nested too deeply, too long, blown up by aliases, or has a key twice.
    """
    if len(text) > MOST_CHARACTERS:
        raise yaml.YAMLError(f"the text is longer than {MOST_CHARACTERS} characters")
    try:
        content = _Loader(text).get_single_data()
        _count(content, 0)
    except RecursionError as error:
        raise yaml.YAMLError("the text is nested too deeply") from error
    except (ValueError, OverflowError, TypeError, KeyError, AttributeError, IndexError) as error:
        # Numbers of thousands of digits, days that no calendar has, and tags without a value.
        raise yaml.YAMLError(f"a value is impossible: {error}") from error
    return content


def _count(value: Any, count: int) -> int:
    if count > MOST_VALUES:
        raise yaml.YAMLError(f"the text stands for more than {MOST_VALUES} values")
    count += 1
    if isinstance(value, dict):
        value = [*value.keys(), *value.values()]
    if isinstance(value, list | tuple | set):
        for item in value:
            count = _count(item, count)
    return count
