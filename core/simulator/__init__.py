"""Simulates recordings of a tractor or an aircraft, in the real formats, with their ground truth.

``simulate.simulate(scenario, folder)`` runs it; ``scenario_file.load_scenario`` reads a scenario.

The simulator verifies the rest of furrowmap, so it shares no code with it: it imports only errors and progress from
other parts of ``core``. Rotations, clocks and formats are implemented again from their sources.

Inside the simulator the map frame is **local**: metres east and north of the ground grid's south-western corner, and
metres above the height of the place; ``t_s`` counts from the scenario's ``t0``. Yaw is in radians, counter-clockwise
from east, of the vehicle's nose. A tractor's metres are those of the map; in a flight, ``Motion.scale`` tells them from
those on the ground, in which ranges, lever arms and the IMU measure. Only the files carry map coordinates, UTC and
headings.
"""
