"""NMEA 0183 logs: sentences, and one receiver's positions of them."""
