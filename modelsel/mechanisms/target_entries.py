"""Mechanisms of the target: of all targets together and, where there are several, of each by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..exceptions import StudyError
from ..robot.kinematics import Robot
from .target_names import choose_targets, limit_steps, limit_to_each, refuse_target
from .terms import Mechanism


@dataclass(frozen=True)
class PerTarget:
    """A mechanism that acts on the target: `build(robot)` for all of them, None where it does not apply.
    `others`: builders of its further forms, under the same name; `targets`: names of several, of which each may be moved by itself, None where they are not known;
    `numbers`: those of the targets in their file."""

    build: Callable[[Robot], Mechanism | None]
    targets: tuple[str, ...] | None = None
    numbers: tuple[int, ...] = ()
    others: tuple[Callable[[Robot], Mechanism | None], ...] = ()

    def __call__(self, robot: Robot) -> Mechanism | None:
        """Build the mechanism of all targets together, in its first form."""
        return self.build(robot)

    def build_forms(self, robot: Robot) -> tuple[Mechanism, ...]:
        """Build every form of the mechanism of all targets together."""
        built = [build(robot) for build in (self.build, *self.others)]
        return tuple(form for form in built if form is not None)


def build_of_target(name: str, robot: Robot, entry: PerTarget) -> tuple[Mechanism, ...]:
    """Build an entry's mechanisms of all targets together, then of each by itself; or that of the one
    that the name says. Raises StudyError for a target that there is not."""
    together = entry.build_forms(robot)
    if not together:
        return ()
    targets = entry.targets or ()
    stem, colon, given = name.partition(":")
    if not colon:
        alone = limit_to_each(together, targets, entry.numbers)
        return (*together, *alone)
    if given not in targets:
        moved, _ = choose_targets(given, targets)
        refused = None if moved else refuse_target(name, given, targets)
        raise refused or StudyError(f'"{name}": {stem} takes the name of one target only.')
    place = targets.index(given)
    return limit_steps(together, [place], targets, entry.numbers)
