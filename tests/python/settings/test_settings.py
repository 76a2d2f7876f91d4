"""Settings: reading, checking, writing, hashing."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from collabslam.errors import SettingsError
from collabslam.settings import table as module
from collabslam.settings.setting import Setting
from collabslam.settings.table import Settings, parse_assignments
from collabslam_lab import switches as lab
from collabslam_lab.switches import with_switches

SETTINGS = [
    Setting(
        "filter.process.density",
        "float",
        1e-5,
        0.0,
        10.0,
        "m/s^1.5",
        (),
        "Noise of the acceleration. " * 6,
        "Raise it.",
    ),
    Setting("filter.process.order", "int", 3, 1, 9, "", (), "Order of the search.", "Lower it."),
    Setting(
        "filter.validation.method",
        "enum",
        "off",
        None,
        None,
        "",
        ("hohct", "off"),
        "How a batch is checked.",
        "Take off.",
    ),
    Setting(
        "frontend.detect.min_distance",
        "float",
        12.0,
        1.0,
        None,
        "pixel",
        (),
        "Distance of corners.",
        "Lower it.",
    ),
    Setting("frontend.detect.refine", "bool", True, None, None, "", (), "Sub-pixel corners.", "Take false."),
    Setting("filter.process.plain", "bool", False, None, None, "", (), "The plain filter, for comparison."),
]
KEYS = {setting.key: setting for setting in SETTINGS}


@pytest.fixture
def _known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_all", lambda: KEYS)
    monkeypatch.setattr(module, "schema", module.schema.__wrapped__)
    monkeypatch.setattr(module, "switches", module.switches.__wrapped__)
    monkeypatch.setattr(lab, "schema", module.schema)
    monkeypatch.setattr(lab, "switches", module.switches)


@pytest.mark.usefixtures("_known")
class TestWithAKnownSchema:
    def test_dump_reads_back_and_explains(self, tmp_path: Path) -> None:
        changed = Settings.default().replace(
            {"filter.process.density": 2.5e-7, "frontend.detect.refine": False}
        )
        text = changed.dump()
        (tmp_path / "a.yaml").write_text(text)
        assert Settings.load(tmp_path / "a.yaml") == changed
        assert "[0 to 10 m/s^1.5; default 1.0e-05]" in " ".join(text.replace("#", " ").split())
        assert max(map(len, text.splitlines())) <= 110
        assert yaml.safe_load(text)["filter"]["validation"]["method"] == "off"

    def test_what_a_file_leaves_out_keeps_its_default(self, tmp_path: Path) -> None:
        (tmp_path / "a.yaml").write_text("filter:\n  process: {density: 1e-3}\nfrontend:\n")
        loaded = Settings.load(tmp_path / "a.yaml")
        assert loaded["filter.process.density"] == pytest.approx(1e-3)
        assert loaded["frontend.detect.min_distance"] == pytest.approx(12.0)
        (tmp_path / "empty.yaml").write_text("")
        assert Settings.load(tmp_path / "empty.yaml") == Settings.default()

    def test_all_faults_are_named_at_once(self) -> None:
        with pytest.raises(SettingsError) as caught:
            Settings.from_dict(
                {
                    "filter": {"process": {"densty": 1.0, "order": 2.5}, "validation": {"method": "ransac"}},
                    "frontend": {"detect": {"min_distance": 0.5, "refine": 1}},
                }
            )
        text = str(caught.value)
        for part in (
            "did you mean 'filter.process.density'",
            "'filter.process.order' is 2.5; it must be a whole number, 1 to 9",
            "'filter.validation.method' is 'ransac'; it must be one of hohct | off",
            "'frontend.detect.min_distance' is 0.5; it must be a number, 1 or more pixel",
            "'frontend.detect.refine' is 1; it must be true or false",
        ):
            assert part in text

    def test_a_key_without_its_groups_is_recognised(self) -> None:
        with pytest.raises(SettingsError, match=r"'frontend\.detect\.min_distance'"):
            Settings.default().replace({"min_distance": 4})

    @pytest.mark.parametrize("value", [float("nan"), float("inf"), True, "much", None, [1.0], 11.0])
    def test_what_is_no_allowed_number_is_refused(self, value: object) -> None:
        with pytest.raises(SettingsError, match="density"):
            Settings.default().replace({"filter.process.density": value})

    def test_hash_follows_the_values_only(self) -> None:
        a = Settings.default()
        assert a.hash() == Settings.from_dict({}).hash()
        assert len(a.hash()) == 12
        assert a.hash() != a.replace({"filter.process.order": 4}).hash()
        assert a.replace({"frontend.detect.min_distance": 12}).hash() == a.hash()

    def test_a_switch_of_the_lab_is_no_setting(self, tmp_path: Path) -> None:
        plain = Settings.default()
        with pytest.raises(SettingsError, match=r"no setting 'filter\.process\.plain'"):
            plain.replace({"filter.process.plain": True})
        switched = with_switches(plain, {"filter.process.plain": True, "filter.process.order": 4})
        assert (switched["filter.process.order"], switched.switch("filter.process.plain")) == (4, True)
        assert switched.section_switches("filter") == {"process.plain": True}
        assert switched.hash() != plain.replace({"filter.process.order": 4}).hash()
        assert Settings.from_state(switched.state()) == switched
        (tmp_path / "a.yaml").write_text(switched.dump())
        assert "filter.process.plain: true" in switched.dump()
        assert Settings.load(tmp_path / "a.yaml") == plain.replace({"filter.process.order": 4})
        assert with_switches(switched, {"filter.process.plain": False}).switches == {}
        with pytest.raises(SettingsError, match="true or false"):
            with_switches(plain, {"filter.process.plain": 1})

    def test_sections_are_flat(self) -> None:
        assert Settings.default().section("frontend") == {"detect.min_distance": 12.0, "detect.refine": True}

    @pytest.mark.parametrize(
        ("text", "part"), [("a: [", "not valid YAML"), ("- 1", "mapping"), ("a: 1", "faults")]
    )
    def test_files_with_faults_are_named(self, tmp_path: Path, text: str, part: str) -> None:
        path = tmp_path / "bad.yaml"
        path.write_text(text)
        with pytest.raises(SettingsError, match=part):
            Settings.load(path)

    def test_a_missing_file_is_named(self, tmp_path: Path) -> None:
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
    assert settings.section("filter")
    assert settings.section("frontend")
    assert settings.replace(settings.values) == settings
    (tmp_path / "all.yaml").write_text(settings.dump())
    assert Settings.load(tmp_path / "all.yaml") == settings
    assert all(entry.doc for entry in module.schema().values())
