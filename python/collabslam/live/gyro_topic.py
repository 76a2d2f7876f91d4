"""A topic of `sensor_msgs/Imu` beside the images of Cs, message by message."""

from __future__ import annotations

from dataclasses import dataclass

from collabslam.datasets.imu.beside import GyroGiven
from collabslam.datasets.imu.description import ImuFile
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import SettingsError
from collabslam.live import messages
from collabslam.live.core import GyroSample
from collabslam.types import Imu


@dataclass(frozen=True)
class GyroTopic:
    """Where a gyroscope's rates come from.

    Attributes
    ----------
    name : str
        Of the topic.
    told : ImuFile
        How it sits and how good it is, as far as that was told; tf tells a mount that was not.
    """

    name: str
    told: ImuFile

    @classmethod
    def of(cls, topic: str, imu: str | None) -> GyroTopic:
        """A topic, and a file or the name of axes; raises DataError as `GyroGiven.description` does."""
        return cls(topic, GyroGiven(topic, imu).description())

    @classmethod
    def asked(cls, topic: str | None, imu: str | None, whose: str = "") -> GyroTopic | None:
        """What options ask for, ``--gyro`` and ``--imu`` with ``whose`` before their names.

        Raises
        ------
        DataError
            As `of`.
        SettingsError
            If a gyroscope is described and not named.
        """
        if topic is None and imu is not None:
            of, topics = f"--{whose}imu", f"--{whose}gyro TOPIC"
            raise SettingsError(f"{of} tells of the gyroscope of {topics}; give that.")
        return None if topic is None else cls.of(topic, imu)

    @property
    def asks_tf(self) -> bool:
        """Whether only tf can tell how it sits."""
        return self.told.r_ci is None

    def sensor(self, tree: TransformTree, camera: str, frame: str) -> Imu | None:
        """The sensor; None until tf links its frame and the camera's."""
        if self.told.r_ci is not None:
            return self.told.sensor(self.told.r_ci)
        t_ci = tree.between(camera, frame, 0.0) if camera and frame else None
        return None if t_ci is None else self.told.sensor(t_ci[:3, :3])


def sample_of(data: bytes) -> tuple[str, GyroSample]:
    """Frame and sample of a message in CDR; raises DataError if it has no rate."""
    message = messages.decoded(messages.IMU, data)
    rate, acceleration = messages.rate_of(message), messages.acceleration_of(message)
    return str(message.header.frame_id), GyroSample(messages.stamp_of(message), rate, acceleration)
