"""Least-squares adjustment of states at knots in time: layout, observations, banded normal equations, covariances."""
