"""A session while it is recorded: poses, the state of the tool and the ground worked, scan by scan."""
