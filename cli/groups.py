"""A group of commands, such as `furrowmap farm add`."""

from __future__ import annotations

from difflib import get_close_matches

import click

from furrowmap.core.runtime.errors import UsageError


class CommandGroup(click.Group):
    """A command group whose error for an unknown command suggests the nearest one."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name.

        Raises:
            UsageError: if there is no such command.
        """
        found = super().get_command(ctx, cmd_name)
        if found is not None or ctx.resilient_parsing:
            return found
        near = get_close_matches(cmd_name, self.commands, 1, 0.5)
        raise UsageError(
            "no-such-verb",
            name=self.name,
            cmd_name=cmd_name,
            near_first=near[0] if near else None,
            commands=", ".join(self.commands) if not (near) else None,
        )
