"""Cloud-optimised point clouds (COPC 1.0, https://copc.io): LAZ 1.4 whose chunks are the nodes of an octree.

``points`` turns batches into LAS records; ``cube`` names the cells of space and ``levels`` draws each point's level;
``octree`` sorts records into nodes, with ``spool`` for those that memory does not hold; ``file`` compresses nodes and
writes header and hierarchy; ``writer`` is what others use. The reasons stand in docs/explanation/copc.md.
"""
