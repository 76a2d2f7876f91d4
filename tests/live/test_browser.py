"""A real browser: a phone's page with a camera that plays Cf's rendered pictures, and the live view.

Screenshots of both pages, 1280 and 390 pixels wide, are left in ``results/pages`` to be looked at.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from browser import CHROMIUM, Browser
from pages_site import SHOTS, SOON, Site
from pages_site import site as site_of
from phone_scene import PHONE
from scenario import frames_of

from collabslam.datasets.imu.description import MOUNTS

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")

SAID = "document.getElementById('said').textContent"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    with site_of(tmp_path_factory.mktemp("site"), PHONE) as site:
        yield site


@pytest.fixture(scope="module")
def phone(site: Site) -> Browser:
    """The phone's page, which sends."""
    page = site.browser.page()
    page.open(site.address("", "phone&start=1"), 1280, 800)
    return page


def fits(page: Browser) -> bool:
    """Whether nothing is cut off at the side."""
    return bool(page.value("document.documentElement.scrollWidth <= innerWidth"))


def test_the_phone_sends_its_camera(site: Site, phone: Browser) -> None:
    assert phone.until("document.getElementById('facts').textContent.includes('images sent')", SOON)
    assert site.until(lambda: site.node.uplink.reports().get("web", {}).get("images", 0) > 20)
    report = site.node.uplink.reports()["web"]
    assert 0.0 < report["age_median_ms"] < 2000.0  # the two clocks began years apart
    assert site.node.uplink.dropped["malformed"] == 0


def test_a_phone_and_a_tag_make_a_metric_pose(site: Site, phone: Browser) -> None:
    """Nothing but the tag that both see tells where the phone is, and that a metre is one."""
    assert site.until(lambda: [link for _, link in frames_of(site.out)].count("collab") > 50)
    assert site.until(site.went)
    way, true = site.ways()
    assert np.abs(way - true).max() < 0.2
    assert phone.until("document.getElementById('facts').textContent.includes('lengths in metresyes')", SOON)
    assert phone.until("document.getElementById('said').textContent === 'The robot uses your images.'", SOON)


@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), (390, "light"), (390, "dark"), (3840, "dark")]
)
def test_the_phone_shows_what_the_robot_sees(phone: Browser, width: int, scheme: str) -> None:
    phone.resize(width, 1000 if width < 3000 else 2160)
    phone.prefer(scheme)
    assert phone.until("document.getElementById('view').naturalWidth > 0", SOON)
    assert phone.until("document.getElementById('facts').rows.length > 5", SOON)
    assert fits(phone)
    phone.screenshot(SHOTS / f"phone-{width}-{scheme}.png")


@pytest.mark.parametrize("width", [1280, 390, 3840])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.usefixtures("phone")
def test_the_view_shows_what_happens(site: Site, width: int, scheme: str) -> None:
    view = site.browser.page()
    view.prefer(scheme)
    view.open(site.address("view", "view"), width, 1400 if width < 3000 else 2160)
    assert view.until(
        "document.getElementById('said').textContent.startsWith('OK · with the worn camera')", SOON
    )
    assert view.until("document.getElementById('view').naturalWidth > 900", SOON)  # both cameras
    assert view.until("document.getElementById('facts').rows.length > 5", SOON)
    assert fits(view)
    view.screenshot(SHOTS / f"view-{width}-{scheme}.png")
    view.close()


def test_before_its_start_a_phone_shows_what_the_robot_sees(site: Site, phone: Browser) -> None:
    other = site.browser.page()
    other.open(site.address("", "phone"), 390, 800)
    assert other.until("document.getElementById('view').naturalWidth > 0", SOON)
    assert other.until("document.getElementById('said').textContent.startsWith('The camera is off')", SOON)
    other.screenshot(SHOTS / "phone-before.png")
    other.close()


def test_a_phones_page_knows_how_it_turns(site: Site) -> None:
    """Rates in degrees about the phone's axes become those of the picture's, as `MOUNTS` has them; held
    otherwise than with its top to the left it says nothing."""
    page = site.browser.page()
    page.open(site.address("", "phone"), 800, 390)
    held = {"type": "landscapePrimary", "angle": 90}
    metrics = {"width": 800, "height": 390, "deviceScaleFactor": 1, "mobile": True}
    page.tell("Emulation.setDeviceMetricsOverride", screenOrientation=held, **metrics)
    page.value("import('/motion.js').then((found) => { window.motion = found; found.listen(); })")
    assert page.until("window.motion !== undefined && screen.orientation.type === 'landscape-primary'", SOON)
    told = "{ alpha: 30, beta: 10, gamma: 20 }"
    turn = f"dispatchEvent(new DeviceMotionEvent('devicemotion', {{ rotationRate: {told} }}))"
    page.value(f"{turn}, dispatchEvent(new DeviceMotionEvent('devicemotion', {{}}))")
    ((t, *rate),) = page.value("motion.rates()")
    np.testing.assert_allclose(rate, MOUNTS["phone-left"] @ np.radians([10.0, 20.0, 30.0]), atol=1e-12)
    assert abs(t - page.value("(performance.timeOrigin + performance.now()) / 1000")) < SOON
    assert page.value("motion.rates()") == []
    for name, angle in (("phone-left", 90), ("phone-right", 270), ("opengl", 0)):
        along = page.value(f"motion.along({told}, {angle})")
        np.testing.assert_allclose(along, MOUNTS[name] @ np.radians([10.0, 20.0, 30.0]), atol=1e-12)
    upright = {"type": "portraitPrimary", "angle": 0}
    page.tell("Emulation.setDeviceMetricsOverride", screenOrientation=upright, **metrics)
    assert page.until("screen.orientation.type === 'portrait-primary'", SOON)
    page.value(f"setTimeout(() => {{ {turn}; window.turned = true; }}, 20)")
    assert page.until("window.turned", SOON)
    assert page.value("motion.rates()") == []
    page.close()


def test_a_wrong_token_is_told(site: Site) -> None:
    view = site.browser.page()
    view.open(site.address("view", "other"), 390, 800)
    assert view.until("document.getElementById('said').textContent.includes('token')", SOON)
    view.close()


def test_a_worn_camera_that_is_silent_is_told(site: Site, phone: Browser) -> None:
    """The robot goes on and its pages stay as they are, but nobody takes the last age for today's."""
    view = site.browser.page()
    view.open(site.address("view", "view"), 390, 1400)
    phone.tell("Page.navigate", url="about:blank")
    assert view.until(
        "[...document.querySelectorAll('tr.bad')].some(r => r.textContent.includes('last image'))", SOON
    )
    assert view.until("document.querySelector('[data-of=persons]').classList.contains('bad')", SOON)
    assert view.until(f"{SAID}.startsWith('OK · alone')", SOON)
    assert view.until("!document.body.classList.contains('silent')", SOON)
    view.screenshot(SHOTS / "view-worn-silent.png")
    view.close()
