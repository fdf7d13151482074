"""Point clouds: placing the returns of a recording on the map, and cleaning, thinning and gridding any LAS cloud."""
