"""From a tractor's LiDAR and GNSS recording to a georeferenced point cloud.

Words and frames used everywhere below (lengths in metres, times in seconds):

* **map**: the session's projected CRS, easting and northing in this order, height above the ellipsoid.
* **vehicle**: origin on the ground below the rear axle's centre; x forward, y left, z up.
* **lidar**: x towards azimuth 0°, y towards azimuth 270°, z along the spin axis.
* ``t_s``: UTC in seconds since 1970 (POSIX). Other clocks have other names.
* ``heading_deg`` is clockwise from grid north, ``roll_deg`` positive right side down, ``pitch_deg``
  positive nose up.

Data flows one way: ``values → readers → trajectory → cloud``, and ``pipeline`` composes them. ``simulator``
stands alone, because it is the oracle of the others. Nothing here imports from another part of furrowmap.
"""
