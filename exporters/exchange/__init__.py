"""The formats other programs take: vector files, task data, catalogues."""
