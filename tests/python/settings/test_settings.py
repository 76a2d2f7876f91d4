"""Settings: reading, checking, writing, hashing."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
import yaml

from collabslam.errors import SettingsError
from collabslam.settings import table as module
from collabslam.settings.table import Settings, parse_assignments
from collabslam_lab.switches import with_switches

DENSITY, ORDER, TEST = (
    "filter.process.acceleration_density",
    "filter.worn.start_births",
    "filter.validate.test",
)
SHARE, FLAG = "frontend.detect.quality", "frontend.worn.next_best_view"


def test_a_value_is_an_attribute_with_its_own_type() -> None:
    settings = Settings.default().replace({"filter.worn.late": 3, FLAG: True, ORDER: "9"})
    assert settings.filter.worn.late == settings["filter.worn.late"] == 3.0
    assert settings.filter.worn.start_births == 9
    assert settings.frontend.worn.next_best_view is True
    assert settings != Settings.default()
    assert pickle.loads(pickle.dumps(settings)) == settings


def test_dump_reads_back_and_explains(tmp_path: Path) -> None:
    changed = Settings.default().replace({DENSITY: 2.5e-7, FLAG: True})
    text = changed.dump()
    (tmp_path / "a.yaml").write_text(text)
    assert Settings.load(tmp_path / "a.yaml") == changed
    assert "[0 to 1000 m/s^1.5; default 1.0]" in " ".join(text.replace("#", " ").split())
    assert max(map(len, text.splitlines())) <= 110
    assert yaml.safe_load(text)["filter"]["process"]["acceleration_density"] == 2.5e-7


def test_what_a_file_leaves_out_keeps_its_default(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("filter:\n  process: {acceleration_density: 1e-3}\nfrontend:\n")
    loaded = Settings.load(tmp_path / "a.yaml")
    assert loaded.filter.process.acceleration_density == pytest.approx(1e-3)
    assert loaded.frontend == Settings.default().frontend
    (tmp_path / "empty.yaml").write_text("")
    assert Settings.load(tmp_path / "empty.yaml") == Settings.default()


def test_all_faults_are_named_at_once() -> None:
    with pytest.raises(SettingsError) as caught:
        Settings.from_dict(
            {
                "filter": {
                    "process": {"acceleration_densty": 1.0},
                    "worn": {"start_births": 2.5},
                    "estimator": {"mode": "x"},
                },
                "frontend": {"detect": {"quality": 2}, "worn": {"next_best_view": 1}},
            }
        )
    text = str(caught.value)
    for part in (
        f"did you mean '{DENSITY}'",
        f"'{ORDER}' is 2.5; it must be a whole number, 1 to 1000",
        "'filter.estimator.mode' is 'x'; it must be one of mono | ",
        f"'{SHARE}' is 2; it must be a number, 0 to 1",
        f"'{FLAG}' is 1; it must be true or false",
    ):
        assert part in text


def test_a_key_without_its_groups_is_recognised() -> None:
    with pytest.raises(SettingsError, match=r"'filter\.worn\.start_births'"):
        Settings.default().replace({"start_births": 4})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "much", None, [1.0], 1e4])
@pytest.mark.parametrize("key", [DENSITY, SHARE])
def test_what_is_no_allowed_number_is_refused(key: str, value: object) -> None:
    with pytest.raises(SettingsError, match=key):
        Settings.default().replace({key: value})


def test_hash_follows_the_values_only() -> None:
    a = Settings.default()
    assert a.hash() == Settings.from_dict({}).hash()
    assert len(a.hash()) == 12
    assert a.hash() != a.replace({ORDER: 4}).hash()
    assert a.replace({DENSITY: 1}).hash() == a.hash()


def test_a_switch_of_the_lab_is_no_setting(tmp_path: Path) -> None:
    plain = Settings.default()
    with pytest.raises(SettingsError, match=rf"no setting '{TEST}'"):
        plain.replace({TEST: "none"})
    switched = with_switches(plain, {TEST: "none", ORDER: 4})
    assert (switched.filter.worn.start_births, switched.filter.validate.test) == (4, "none")
    assert switched.switches == {TEST: "none"}
    assert switched.hash() != plain.replace({ORDER: 4}).hash()
    assert Settings.from_state(switched.state()) == switched
    (tmp_path / "a.yaml").write_text(switched.dump())
    assert f"{TEST}: none" in switched.dump()
    assert Settings.load(tmp_path / "a.yaml") == plain.replace({ORDER: 4})
    assert with_switches(switched, {TEST: "hohct"}).switches == {}
    with pytest.raises(SettingsError, match="must be one of"):
        with_switches(plain, {TEST: 1})


@pytest.mark.parametrize(
    ("text", "part"), [("a: [", "not valid YAML"), ("- 1", "mapping"), ("a: 1", "faults")]
)
def test_files_with_faults_are_named(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=part):
        Settings.load(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"nowhere\.yaml"):
        Settings.load(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize("section", ["filter", "frontend"])
def test_each_part_refuses_what_is_just_outside_its_ranges(section: str) -> None:
    numbers = [s for k, s in module.schema().items() if k.startswith(section) and s.high is not None]
    assert len(numbers) > 5
    for setting in numbers:
        assert setting.low is not None
        for value in (setting.low, setting.high):
            assert Settings.default().replace({setting.key: value})[setting.key] == value
        for value in (setting.low - 0.01, setting.high * 1.01):
            with pytest.raises(SettingsError, match=f"'{setting.key}' is .*it must be a"):
                Settings.default().replace({setting.key: value})


def test_whole_and_written_numbers_are_taken_as_the_filter_takes_them() -> None:
    settings = Settings.default().replace({"filter.map.in_view": 50.0, "filter.pixel.sigma_cs": "2e0"})
    assert settings["filter.map.in_view"] == 50
    assert isinstance(settings["filter.map.in_view"], int)
    assert settings["filter.pixel.sigma_cs"] == pytest.approx(2.0)


def test_assignments_are_read_as_yaml() -> None:
    assert parse_assignments(["a.b=0.5", "c=true", "d=hohct"]) == {"a.b": 0.5, "c": True, "d": "hohct"}
    for bad in ("a.b", "=3", "a=[1"):
        with pytest.raises(SettingsError):
            parse_assignments([bad])


def test_the_real_defaults_are_allowed_and_read_back(tmp_path: Path) -> None:
    settings = Settings.default()
    assert settings.replace(settings.values) == settings
    (tmp_path / "all.yaml").write_text(settings.dump())
    assert Settings.load(tmp_path / "all.yaml") == settings
    assert all(entry.doc for entry in module.schema().values())
