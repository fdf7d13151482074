"""Coordinate reference systems: choice, change, projection, datum, epoch, height systems, grid convergence."""
