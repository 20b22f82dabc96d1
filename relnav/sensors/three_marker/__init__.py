"""Three-marker vision: relative position and attitude from the spots of one image.

Source: Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
"""

from relnav.sensors.three_marker.as_published import closed_form_flat, closed_form_raised, depth_iteration, small_angle
from relnav.sensors.three_marker.camera import project
from relnav.sensors.three_marker.jacobians import SpotJacobians, spot_jacobians
from relnav.sensors.three_marker.measure import measure, measure_image
from relnav.sensors.three_marker.outcome import PoseMeasurement
from relnav.sensors.three_marker.pose import Pose, Root
from relnav.sensors.three_marker.sensor import Imager, MarkerCamera, Markers, ThreeMarkerModel, View
from relnav.sensors.three_marker.spots import Spots, find_spots

__all__ = [
    "Imager",
    "MarkerCamera",
    "Markers",
    "Pose",
    "PoseMeasurement",
    "Root",
    "SpotJacobians",
    "Spots",
    "ThreeMarkerModel",
    "View",
    "closed_form_flat",
    "closed_form_raised",
    "depth_iteration",
    "find_spots",
    "measure",
    "measure_image",
    "project",
    "small_angle",
    "spot_jacobians",
]
