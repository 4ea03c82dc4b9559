"""What Foxglove and PlotJuggler make of a recording: results by path, samples as an IMU's."""

import math
import re
import struct
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
from google.protobuf import message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool

from pipeline.export.imu import export_imu, imus_of
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.errors import InputError
from tests.pipeline.example_messages import LAYOUT, START_NS, block
from tests.pipeline.report.example_session import estimate, event, posterior, recorded

PATHS = (  # topic of turbine t1, path, and what it must be
    ("foundation-posterior", "parameters[1].median", posterior(1).parameter("k22").median),
    ("foundation-posterior", "parameters[1].p05", posterior(1).parameter("k22").p05),
    ("foundation-posterior", "parameters[1].nominal", posterior(1).parameter("k22").nominal),
    ("foundation-posterior", "reduced_chi_square", posterior(1).reduced_chi_square),
    ("foundation-posterior", "trusted", posterior(1).trusted),
    ("modal-estimate", "modes[0].frequency", estimate(1).modes[0].frequency),
    ("modal-estimate", "modes[0].frequency_std", estimate(1).modes[0].frequency_std),
    ("modal-estimate", "modes[0].damping_ratio", estimate(1).modes[0].damping_ratio),
    ("foundation-event", "probability", event().probability),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("interoperability") / "session.mcap"
    results = [estimate(1), posterior(1), event()]
    return recorded(path, [LAYOUT, *map(block, range(3)), *results])


@pytest.mark.parametrize(("topic", "path", "expected"), PATHS)
def test_a_result_is_a_scalar_at_its_path_by_the_schema_in_the_file_alone(
    session: Path, topic: str, path: str, expected: float
):
    with session.open("rb") as file:
        schema, channel, message = next(
            mcap.reader.make_reader(file).iter_messages([f"pilewatch/t1/{topic}"])
        )
    assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
    pool = DescriptorPool()
    for described in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(described)
    found = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    value = found.FromString(message.data)
    for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", path):
        value = getattr(value, name)
        value = value[int(index)] if index else value
    assert value == expected


def test_a_sample_is_a_message_of_its_levels_imu_at_its_own_time(session: Path, tmp_path: Path):
    (written,) = export_imu(session, tmp_path)
    with written.path.open("rb") as file:
        reader = mcap.reader.make_reader(file)
        messages = list(reader.iter_messages())
        assert reader.get_header().profile == "ros2"
    levels = [f"/t1/tower/z{z}/imu" for z in (41, 80, 106, 145)]
    assert {channel.topic for _, channel, _ in messages} == set(levels)
    assert written.rows == len(messages) == 3 * 40 * 4
    for level, topic in enumerate(levels):
        of_level = [(s, m) for s, channel, m in messages if channel.topic == topic]
        read = [read_imu(message.data) for _, message in of_level]
        times = [START_NS + i * NANOSECONDS // 40 for i in range(120)]
        assert [message.log_time for _, message in of_level] == times
        assert [stamp for stamp, *_ in read] == times
        assert {frame for _, frame, _ in read} == {f"t1/tower/z{(41, 80, 106, 145)[level]}"}
        samples = np.concatenate([block(number).samples for number in range(3)])
        along = np.array([acceleration for *_, acceleration in read])
        for axis, name in enumerate(("fa", "ss")):
            column = LAYOUT.channel_names.index(f"{topic.split('/')[3]}-{name}")
            np.testing.assert_array_equal(along[:, axis], samples[:, column])
        assert np.isnan(along[:, 2]).all()  # nobody measures along the tower
    schema = of_level[0][0]
    assert (schema.name, schema.encoding) == ("sensor_msgs/msg/Imu", "ros2msg")
    assert schema.data.startswith(b"std_msgs/Header header\n")


def read_imu(data: bytes) -> tuple[int, str, tuple[float, ...]]:
    """Stamp [ns], frame, linear acceleration of a sensor_msgs/Imu, read field by field as CDR."""
    assert data[:4] == b"\x00\x01\x00\x00"
    body = data[4:]
    seconds, nanoseconds, length = struct.unpack_from("<iII", body)
    frame = body[12 : 12 + length]
    assert frame[-1] == 0
    start = math.ceil((12 + length) / 8) * 8
    figures = struct.unpack_from("<37d", body, start)
    assert start + 37 * 8 == len(body)
    orientation_covariance, angular_velocity_covariance = figures[4:13], figures[16:25]
    assert orientation_covariance[0] == angular_velocity_covariance[0] == -1.0
    return seconds * NANOSECONDS + nanoseconds, frame[:-1].decode(), figures[25:28]


def channel(name: str, elevation: float, angle: float, unit: str = "m/s²") -> Accelerometer:
    direction = (math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0)
    return Accelerometer(name, elevation, direction, unit=unit)


def test_axes_that_stand_askew_give_the_acceleration_along_the_towers():
    layout = SensorLayout("l", "t", "u", (channel("a", 50.0, 30.0), channel("b", 50.0, 105.0)))
    (imu,) = imus_of(layout)
    acceleration = np.array([0.7, -0.2, 0.0])
    read = layout.directions @ acceleration
    found = imu.accelerations(read[None].astype(np.float32))[0]
    assert found[:2] == pytest.approx(acceleration[:2], abs=1e-6)
    assert np.isnan(found[2])


def test_a_lone_askew_axis_knows_neither_direction_for_itself():
    (imu,) = imus_of(SensorLayout("l", "t", "u", (channel("a", 50.0, 30.0),)))
    assert np.isnan(imu.accelerations(np.ones((1, 1), np.float32))).all()


def test_a_second_sensor_of_the_same_direction_at_a_level_is_an_imu_of_its_own():
    layout = SensorLayout(
        "l", "t", "u", tuple(channel(f"c{i}", 50.0, angle) for i, angle in enumerate((0, 0, 90)))
    )
    assert [(imu.name, imu.columns) for imu in imus_of(layout)] == [
        ("z50", (0, 2)),
        ("z50-2", (1,)),
    ]


def test_what_is_no_acceleration_is_not_given_out_as_one(tmp_path: Path):
    velocities = SensorLayout(LAYOUT.layout_id, "t1", "tower", (channel("v", 50.0, 0.0, "mm/s"),))
    with pytest.raises(InputError, match=r"channel v of layout .* is in mm/s"):
        imus_of(velocities)
    path = recorded(tmp_path / "a.mcap", [velocities, block(0)])
    with pytest.raises(InputError, match="has no positions of the 8 channels of unit tower"):
        export_imu(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())
