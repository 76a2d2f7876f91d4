"""Parameters of the ROS 2 package's node: the options of ``collabslam live ros``, and every setting.

The node is `run`; the package's ``config/collabslam.yaml`` is `parameters_text`.  Nothing here is told twice:
names, defaults and help are the options' and the settings table's.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from collabslam.cli import live_ros
from collabslam.errors import CollabslamError, SettingsError
from collabslam.settings.setting import Setting
from collabslam.settings.table import Settings, schema

_LEFT_OUT = ("set",)
"""Options that are no parameters: each setting is one itself."""
_WIDTH = 110


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SettingsError(f"The parameters do not do: {message}.")


def options() -> dict[str, argparse.Action]:
    """The options that are parameters, by the parameter's name: ``--cs-info`` is ``cs_info``."""
    parser = _Parser(add_help=False)
    live_ros.configure(parser)
    return {a.dest: a for a in parser._actions if a.option_strings and a.dest not in _LEFT_OUT}


def default_of(action: argparse.Action) -> str | float | list[str]:
    """A parameter's value where it is not given: none is an empty text, or a list with one."""
    if isinstance(action, argparse._AppendAction):
        return [""]
    return action.default if isinstance(action.default, float) else str(action.default or "")


def arguments_of(values: Mapping[str, Any]) -> argparse.Namespace:
    """The arguments that parameters stand for; raises SettingsError as the command line would complain."""
    parser = _Parser(add_help=False)
    live_ros.configure(parser)
    words = []
    for name, action in options().items():
        value = values.get(name)
        several = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
        words += [f"{action.option_strings[0]}={one}" for one in several if one not in (None, "")]
    return parser.parse_args(words)


def settings_of(values: Mapping[str, Any], config: str = "") -> Settings:
    """Settings of the parameters that are not at their defaults, over a file's; raises SettingsError."""
    changed = {
        key: value for key, value in values.items() if key in schema() and value != schema()[key].default
    }
    base = Settings.load(config) if config else Settings.default()
    return base.replace(changed)


def parameters_text() -> str:
    """All parameters with their help as YAML of ROS."""
    lines = [
        "# Made from 'collabslam live ros' and the table of settings by packaging/ros_parameters.py.",
        "# What is empty is not given.",
        "/**:",
        "  ros__parameters:",
    ]
    for name, action in options().items():
        help_text = (action.help or "").replace("%(default)s", str(action.default))
        help_text = help_text.replace("%(default)g", str(action.default))
        lines += [*_comment(help_text, 4), f"    {name}: {_yaml(default_of(action))}"]
    groups: list[str] = []
    for key, setting in schema().items():
        *above, name = key.split(".")
        shared = next((k for k, (a, b) in enumerate(zip(above, groups, strict=False)) if a != b), None)
        start = min(len(above), len(groups)) if shared is None else shared
        lines += [f"{'  ' * (2 + k)}{above[k]}:" for k in range(start, len(above))]
        groups, indent = above, 4 + 2 * len(above)
        lines += [*_comment(_told(setting), indent), f"{' ' * indent}{name}: {_yaml(setting.default)}"]
    return "\n".join(lines) + "\n"


def _told(setting: Setting) -> str:
    """What there is to know of a setting."""
    unit = f", {setting.unit}" if setting.unit else ""
    return f"{setting.doc} ({setting.allowed()}{unit}). {setting.when}"


def _comment(text: str, indent: int) -> list[str]:
    lines = textwrap.wrap(text, _WIDTH - indent - 2) or [""]
    return [f"{' ' * indent}# {line}" for line in lines]


def _yaml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    text = repr(value)
    return text.replace("e-", ".0e-") if isinstance(value, float) and "." not in text else text


def run(arguments: Sequence[str] | None = None) -> int:
    """The package's node: reads its parameters and runs until Ctrl-C; returns the exit status."""
    from collabslam.live.ros import NAME
    from collabslam.live.ros_types import rclpy_of

    rclpy = rclpy_of()
    rclpy.init(args=arguments)
    node = rclpy.create_node(NAME)
    try:
        values = declared(node)
        given = arguments_of(values)
        settings = settings_of(values, str(given.config or ""))

        def maps() -> Any:
            now = [str(node.get_parameter(name).value or "") for name in ("map", "save_map")]
            return live_ros.map_files(*now)

        return live_ros.spin(node, given, settings, maps)
    except CollabslamError as error:
        node.get_logger().fatal(str(error))
        return 2


def declared(node: Any) -> dict[str, Any]:
    """Declares all parameters; their values by name."""
    from importlib import import_module

    descriptor = import_module("rcl_interfaces.msg").ParameterDescriptor
    rows = {name: (default_of(action), action.help or "") for name, action in options().items()}
    rows |= {key: (setting.default, _told(setting)) for key, setting in schema().items()}
    return {
        name: node.declare_parameter(
            name, default, descriptor(description=" ".join(text.split()), dynamic_typing=True)
        ).value
        for name, (default, text) in rows.items()
    }
