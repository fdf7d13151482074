"""Spinning scanners of several lasers: packets of any maker by tables, to scans."""
