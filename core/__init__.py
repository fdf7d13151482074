"""From recordings of LiDAR, GNSS and IMU to georeferenced points and the ground worked: values in, values out.

Notation
========

Names end with the unit: ``_m``, ``_s``, ``_deg``, ``_rad``, ``_mps``, ``_m2``. Lengths are metres, times seconds;
angles are degrees in values and files, radians within the adjustment.

Frames, all right-handed:

* **map** (m): the session's projected CRS; easting, northing in this order, and height in its height system.
* **local**: the map less a round local origin ``origin_m``, so that float32 and whole millimetres suffice.
* **vehicle** (b, *body*; REP-103): origin on the ground below the middle of the rear axle; x forward, y left, z up.
* **lidar** (l): x towards azimuth 0°, y towards azimuth 270°, z along the spin axis.
* **imu**: as its session states it in the vehicle frame.
* **optical**: of a camera; x right in the image, y down, z along the axis; pixel (0, 0) is the middle of the first one.

Places and rotations:

* ``xyz_m`` (n, 3) are coordinates in the frame that the name or the docstring states. The lever arm ``lever_m`` is the
  antenna in the vehicle frame.
* ``quaternion`` (n, 4) is (w, x, y, z), and ``rotation`` (3, 3) its matrix: both rotate vehicle to map coordinates. A
  mounting rotates sensor to vehicle coordinates.
* A point of the scanner is in the map at ``x_m = p + R_mb (t_b + R_bl x_l)``: p, R_mb of the trajectory at the point's
  own time; t_b, R_bl of the mounting.
* Mountings state ``rpy_deg``, with ``R_bl = Rz(yaw) Ry(pitch) Rx(roll)``.
* Attitudes of vehicles are ``roll_deg`` (positive right side down), ``pitch_deg`` (positive nose up: about −y) and
  ``heading_deg`` (clockwise from grid north, [0°, 360°)); yaw about the map's up axis is 90° − heading.

Times:

* ``t_s`` is UTC in POSIX seconds: since 1970, without leap seconds. Other clocks have other names; GPS time is ahead by
  the leap seconds inserted since 1980.
* ``a_minus_b_s`` is the offset of clock a against b: what is subtracted from a's times to have b's.

Adjustment:

* **Knots** lie ``KNOT_STEP_S`` apart; a state has at each six columns of its pose: position (m), and a rotation vector
  (rad) about the map's axes, ``R ← exp(step) R``; blocks such as the slow error of GNSS or the biases of an IMU follow.
* Normal equations ``N x = b`` are sums of ``A' W A`` and ``A' W r``, whose steps add to the state. N is banded.
* ``sigma`` is one standard deviation, ``covariance`` the matrix; ``variance`` its square. nan is unknown.
* Poses have ``sigma`` (n, 6): easting, northing, height (m), roll, pitch, heading (degrees).

Grids: row 0 is the northernmost, as in rasters; edges of cells are multiples of their side from the CRS origin.

Data flows one way: ``values → readers → trajectory → matching → pipeline``. ``simulator`` stands alone, because it is
the oracle of the others. Nothing here imports from another part of furrowmap.
"""
