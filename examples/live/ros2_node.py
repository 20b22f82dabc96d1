"""A ROS 2 node: spots of the markers in, the docking port's pose with covariance out.

source /opt/ros/jazzy/setup.bash && python examples/live/ros2_node.py --ros-args -p model:=three_marker_vision

Subscribes to `spots` (sensor_msgs/JointState: `name` spot_a_x_px, spot_a_y_px, ..., `position` their values; a spot
that was not seen is left out or NaN; the stamp is the middle of the exposure). Publishes `pose`
(geometry_msgs/PoseWithCovarianceStamped): the chaser's docking port in frame `target_port`. Needs rclpy beside relnav;
all that relnav does is in `Estimator`, which needs neither (`tests/docs/test_live_examples.py` runs it).
"""

import numpy as np
from scipy.spatial.transform import Rotation

import relnav
from relnav.files.ros_bag import pose_covariance

RELY_ON = 18.4  # below: another pose explains the images almost as well


class Estimator:
    """Spots by their names to poses."""

    def __init__(self, model: str) -> None:
        """Load a marker model, a shipped name or a path."""
        mission = relnav.load_model(model)
        self.navigator = relnav.PoseNavigator(mission)
        self.markers = len(mission.markers.positions_m)

    def step(
        self, stamp: tuple[int, int], values: dict[str, float]
    ) -> tuple[list[float], list[float], list[float]] | None:
        """Position m, quaternion x y z w and the 36 numbers of the covariance; None if there is none to rely on.

        `stamp`: seconds and nanoseconds.
        """
        spots = np.full((self.markers, 2), np.nan)
        for k in range(self.markers):
            for j, axis in enumerate("xy"):
                spots[k, j] = values.get(f"spot_{chr(ord('a') + k)}_{axis}_px", np.nan)
        record = self.navigator.step(stamp[0] + 1e-9 * stamp[1], spots)
        if record.docking is None or record.alarm or record.ambiguity < RELY_ON:
            return None
        port = record.docking
        turn = Rotation.from_matrix(port.dcm_target_from_chaser).as_quat(canonical=True)
        return port.position_m.tolist(), turn.tolist(), pose_covariance(port.covariance).ravel().tolist()


def main() -> None:
    """Run the node until it is told to end."""
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from rclpy.node import Node
    from sensor_msgs.msg import JointState

    rclpy.init()
    node = Node("relnav")
    estimator = Estimator(node.declare_parameter("model", "three_marker_vision").value)
    publisher = node.create_publisher(PoseWithCovarianceStamped, "pose", 10)

    def seen(message: JointState) -> None:
        stamp = message.header.stamp
        try:
            found = estimator.step((stamp.sec, stamp.nanosec), dict(zip(message.name, message.position, strict=False)))
        except ValueError as error:  # a time that goes back, a number that is none
            node.get_logger().warning(str(error))
            return
        if found is None:
            return
        position, turn, covariance = found
        out = PoseWithCovarianceStamped()
        out.header.stamp, out.header.frame_id = stamp, "target_port"
        at, way = out.pose.pose.position, out.pose.pose.orientation
        at.x, at.y, at.z = position
        way.x, way.y, way.z, way.w = turn
        out.pose.covariance = covariance
        publisher.publish(out)

    node.create_subscription(JointState, "spots", seen, 10)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
