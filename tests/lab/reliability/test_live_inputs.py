"""What devices and pages send, altered: nothing is found, and what would be found is."""

from __future__ import annotations

import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("rosbags", reason="the extra live is not installed")

from collabslam.live import names, web
from collabslam.live.uplink import Uplink
from collabslam_lab.reliability.live_inputs import fuzz_live, good_messages


def test_good_messages_are_good() -> None:
    up = Uplink(lambda event: None, lambda: 7.0)
    for part, payload in good_messages().items():
        up.take(names.key("anna", part), payload)
    assert "malformed" not in up.counts()
    assert set(good_messages()) == set(names.PARTS)


def test_nothing_is_found() -> None:
    found = fuzz_live(1500, 3)
    assert found.findings == []
    assert found.executions == 3000
    assert 0 < found.refused < found.executions


def test_what_raises_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "_is_time", lambda value: float(value) < 1e11)
    assert any("page" in finding for finding in fuzz_live(300, 0).findings)
