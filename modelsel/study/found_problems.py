"""What is wrong with a study's inputs, collected so that all of it is said at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ..exceptions import DataError, StudyError


@dataclass
class FoundProblems:
    """Problems of the `study` file's values, of the robot's file, and those of the measurements."""

    study: list[str] = field(default_factory=list)
    robot: list[str] = field(default_factory=list)
    data: list[DataError] = field(default_factory=list)

    @contextmanager
    def of_study(self) -> Iterator[None]:
        """Keep the problems that are raised inside as the study's."""
        try:
            yield
        except StudyError as error:
            self.study += error.problems

    @contextmanager
    def of_robot(self) -> Iterator[None]:
        """Keep the problems that are raised inside as those of the robot's file."""
        try:
            yield
        except StudyError as error:
            self.robot += error.problems

    @contextmanager
    def of_data(self) -> Iterator[None]:
        """Keep the problems that are raised inside as those of the measurements, or of what the
        study says of them."""
        try:
            yield
        except StudyError as error:
            self.study += error.problems
        except DataError as error:
            said = [str(earlier) for earlier in self.data]
            if str(error) not in said:
                self.data.append(error)

    def list_all(self, study_file: str = "") -> list[str]:
        """List all problems, those of the study with the name of its file."""
        place = f"{study_file}: " if study_file else ""
        told = [f"{place}{problem}" for problem in self.study]
        measured = [str(error) for error in self.data]
        return list(dict.fromkeys([*told, *self.robot, *measured]))

    def refuse(self) -> None:
        """Raise what was found: StudyError, or DataError where the measurements alone are wrong."""
        if self.study or self.robot:
            raise StudyError(*self.list_all())
        if self.data:
            first, *others = self.data
            raise first.beside(others)
