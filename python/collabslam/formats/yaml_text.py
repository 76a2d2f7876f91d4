"""The one place that parses YAML: no code is run, and nothing is built that is far larger than the text."""

from __future__ import annotations

from typing import Any

import yaml

MOST_CHARACTERS = 1 << 20
MOST_VALUES = 100_000
"""Values in the tree, those that aliases repeat counted each time."""


def load_yaml(text: str) -> Any:
    """The content of a YAML text in plain types.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, nested too deeply, too long, or blown up by aliases.
    """
    if len(text) > MOST_CHARACTERS:
        raise yaml.YAMLError(f"the text is longer than {MOST_CHARACTERS} characters")
    try:
        content = yaml.safe_load(text)
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
