"""Features of a cloud: ground, horizontal and vertical planes, lines, plants, by the shape of neighbourhoods."""
