"""The gate of inertial samples, and the files they come in: what is read, left out, told and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.gyro import lines, samples

from collabslam.datasets.gate import listening
from collabslam.datasets.imu.files import read_table
from collabslam.datasets.imu.log import checked, gaps_text
from collabslam.errors import DataError
from collabslam.types import Imu

SENSOR = Imu(np.eye(3))
TIMES, RATES = samples(100.0, 4.0)
GRAVITY = np.tile([0.1, -9.7, 0.9], (len(TIMES), 1))


def said(what: str, *arguments: object) -> str:
    with listening() as facts:
        checked(*arguments, SENSOR, "imu.csv")  # type: ignore[arg-type]
    return "; ".join(fact.value for fact in facts if fact.what == what)


def test_what_can_be_used_stays_as_it_is() -> None:
    log = checked(TIMES, RATES, GRAVITY, SENSOR, "imu.csv")
    np.testing.assert_array_equal(log.times, TIMES)
    np.testing.assert_array_equal(log.rates, RATES)
    np.testing.assert_array_equal(log.accelerations, GRAVITY)
    assert log.left_out == 0
    assert gaps_text(log) == "no gaps"
    assert said("gyroscope", TIMES, RATES, None) == "800 samples at 200 a second, 4.00 s"


def test_what_cannot_is_left_out_and_counted() -> None:
    times, rates = TIMES.copy(), RATES.copy()
    rates[5, 1] = np.nan
    rates[7, 2] = -1e3
    times[300] = times[299]  # repeats
    times[400] = times[380]  # comes late
    log = checked(times, rates, GRAVITY, SENSOR, "imu.csv")
    assert log.left_out == 4
    assert (np.diff(log.times) > 0.0).all()
    assert log.accelerations is not None
    assert len(log.accelerations) == len(log) == 796
    text = said("gyroscope", times, rates, None)
    assert "1 not finite" in text
    assert "2 out of order" in text
    assert "1 too fast" in text


def test_a_sensor_that_repeats_itself_or_stands_at_its_limit() -> None:
    stuck = RATES.copy()
    stuck[100:110] = stuck[99]  # 50 ms: a coarse sensor may
    assert checked(TIMES, stuck, None, SENSOR, "imu.csv").left_out == 0
    times, rates = samples(0.0, 20.0)
    rates[1000:1300] = rates[999]
    assert checked(times, rates, None, SENSOR, "imu.csv").left_out == 300
    assert "300 stuck or clipped" in said("gyroscope", times, rates, None)
    assert "1 gaps, the longest of 1.50 s" in said("gyroscope", times, rates, None)
    with pytest.raises(DataError, match=r"799 stuck or clipped.*--gyro none"):
        checked(TIMES, np.tile(RATES[0], (800, 1)), None, SENSOR, "imu.csv")
    rates = 12.0 * RATES
    clipped = np.clip(rates, -4.7, 4.7)
    log = checked(TIMES, clipped, None, SENSOR, "imu.csv")
    assert 20 < log.left_out < 160
    assert np.abs(log.rates).max() <= 4.7
    assert (np.abs(log.rates[:, 0]) == 4.7).sum() < 3  # none of a run


@pytest.mark.parametrize(
    ("times", "rates", "message"),
    [
        (TIMES, np.rad2deg(RATES), "degrees a second.*0.0174533"),
        (TIMES, 300.0 * RATES, "degrees a second, or counts"),
        (1000.0 * TIMES, RATES, "which no gyroscope's are.*seconds"),
        (TIMES / 1e4, RATES, "which no gyroscope's are"),
        (np.r_[TIMES[:400], TIMES[400:] - 3.0], RATES, r"set back at .*clock was set"),
        (TIMES[:1], RATES[:1], "holds 1 samples"),
        (TIMES, np.where(np.arange(800)[:, None] % 3 == 0, np.nan, RATES), "too few can be used"),
    ],
)
def test_what_is_no_log_is_refused_by_name(times: np.ndarray, rates: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message) as error:
        checked(times, rates, None, SENSOR, "imu.csv")
    assert "--gyro none" in str(error.value)


@pytest.mark.parametrize(("scale", "why"), [(1 / 9.80665, "it is in g"), (0.01, "without gravity")])
def test_an_accelerometer_without_gravity_is_passed_over(scale: float, why: str) -> None:
    assert checked(TIMES, RATES, scale * GRAVITY, SENSOR, "imu.csv").accelerations is None
    assert why in said("passed over", TIMES, RATES, scale * GRAVITY)


NS = [f"{1_700_000_000_000_000_000 + 5_000_000 * k}" for k in range(len(TIMES))]
SECONDS = [f"{1_700_000_000 + k / 200:.6f}" for k in range(len(TIMES))]
MARS = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]\n"
PHYPHOX = '"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)"\n'
EUROC = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1]"


@pytest.mark.parametrize(
    ("header", "stamps", "order", "accelerations"),
    [
        ("", SECONDS, "xyz", False),
        ("", NS, "xyz", True),
        (f"{EUROC},a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n", NS, "xyz", True),
        ("stamp,wx,wy,wz\n", SECONDS, "xyz", False),
        ("# t wx wy wz ax ay az\n", SECONDS, "xyz", True),
        ("time,z,y,x\n", NS, "zyx", False),
        (MARS, NS, "xyz", True),
        (PHYPHOX, SECONDS, "xyz", False),
    ],
)  # fmt: skip
def test_columns_by_header_and_by_number(
    tmp_path: Path, header: str, stamps: list[str], order: str, accelerations: bool
) -> None:
    file = tmp_path / "gyro.csv"
    rates = RATES[:, ["xyz".index(axis) for axis in order]]
    file.write_text(header + lines(stamps, rates, *([GRAVITY] if accelerations else [])))
    table = read_table(file)
    np.testing.assert_allclose(table.clocks[0], [float(text) for text in SECONDS], atol=1e-6)
    np.testing.assert_array_equal(table.rates, RATES)
    assert (table.accelerations is not None) == accelerations
    assert table.phone == ("Gyroscope x" in header)


@pytest.mark.parametrize(
    ("rate", "unit"), [(1000.0, 1e3), (200.0, 1e6), (100.0, 1e3), (1000.0, 1e6), (400.0, 1.0)]
)
def test_stamps_without_years_are_of_the_unit_that_gives_a_gyroscopes_rate(
    tmp_path: Path, rate: float, unit: float
) -> None:
    times, rates = samples(0.0, 1.0, rate)
    (tmp_path / "gyro.csv").write_text(lines([f"{unit * t:.6f}" for t in times], rates))
    np.testing.assert_allclose(read_table(tmp_path / "gyro.csv").clocks[0], times, atol=1e-5)


def test_a_phones_log_tells_two_clocks(tmp_path: Path) -> None:
    file = tmp_path / "Gyroscope.csv"
    elapsed = np.arange(len(TIMES))[:, None] / 200
    file.write_text("time,seconds_elapsed,z,y,x\n" + lines(NS, elapsed, RATES[:, ::-1]))
    table = read_table(file)
    assert table.phone
    np.testing.assert_array_equal(table.rates, RATES)
    np.testing.assert_allclose(table.clocks[0][3], 1_700_000_000.015)
    np.testing.assert_allclose(table.clocks[1][3], 0.015)


def test_a_log_that_broke_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    file = tmp_path / "gyro.csv"
    text = lines(SECONDS, RATES)
    file.write_text(text[: text.rindex(",")])
    with listening() as facts:
        assert len(read_table(file).rates) == len(RATES) - 1
    assert "1 lines (broken)" in [fact.value for fact in facts]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("gyro.csv", "", "holds no samples"),
        ("gyro.csv", "1.0,2.0,3.0\n1.1,2.0,3.0\n", "has 3 columns.*4 are needed"),
        ("gyro.csv", "stamp,a,b,c\n1.0,2.0,3.0,4.0\n", "names no stamp with wx"),
        ("gyro.csv", "t,gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s]\n1,2,3,4\n", "in degrees.*0.0174533"),
        ("gyro.csv", "time,x (\u00b0/s),y (\u00b0/s),z (\u00b0/s)\n1,2,3,4\n", "is in degrees"),
        ("gyro.csv", "1.0 2 3 4\nx y z w\n1.1 2 3 4\n", "Line 2 of .* has not the numbers"),
        ("Accelerometer.csv", "time,seconds_elapsed,z,y,x\n1,2,3,4,5\n", "no log of a gyroscope"),
        ("log.gcsv", "GYROFLOW IMU LOG\nversion,1.3\nt,gx,gy,gz\n0,1,2,3\n", "Gyroflow's log"),
        ("metadata", '{"poses": [1, 2]}', "Record3D"),
    ],
)  # fmt: skip
def test_files_of_other_things_are_refused_by_name(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=message):
        read_table(tmp_path / name)
