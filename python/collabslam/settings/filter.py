"""Settings of the filter, as it lists and checks them itself."""

from __future__ import annotations

from typing import Any

from collabslam._core import accepted_value, settings_schema
from collabslam.settings.setting import Setting, Value


class FilterSetting(Setting):
    """A setting of the filter, which alone decides what it may be."""

    def accepted(self, value: Any) -> Value | None:
        """``value`` as the filter takes it; None if it does not."""
        return accepted_value(self.key.removeprefix("filter."), value)


FILTER: list[Setting] = [
    FilterSetting(
        item.key,
        item.type,
        item.default,
        item.min,
        item.max,
        item.unit,
        tuple(item.choices),
        item.doc,
        item.when or "",
    )
    for item in settings_schema()
]
"""Every setting and switch, in the order of the groups and their fields."""
