"""Values shared by all packages: frozen, validated when created, with units in their names."""
