"""What is wrong with a study's inputs, collected so that all of it is said at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ...exceptions import DataError, StudyError


@dataclass
class FoundProblems:
    """Problems of the `study` file's values, of the robot's file, and those of the measurements.
    `study_file`: the name of the first; empty for a study that was made in Python."""

    study_file: str = ""
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

    def list_all(self) -> list[str]:
        """List all problems, those of the study with the name of its file."""
        told = place_problems(self.study, self.study_file)
        measured = [str(error) for error in self.data]
        return list(dict.fromkeys([*told, *self.robot, *measured]))

    def make_error(self) -> StudyError | DataError | None:
        """Make the error that says what was found: a DataError where the measurements alone are
        wrong; None where nothing is."""
        if self.study or self.robot:
            return StudyError(*self.list_all())
        if not self.data:
            return None
        first, *others = self.data
        return first.beside(others)

    def refuse(self) -> None:
        """Raise what was found, if anything."""
        error = self.make_error()
        if error is not None:
            raise error


def place_problems(problems: Iterable[str], study_file: str) -> list[str]:
    """Say of each problem of a study in which file it is; of a study made in Python there is none."""
    if not study_file:
        return list(problems)
    return [f"{study_file}: {problem}" for problem in problems]


@contextmanager
def name_study_file(study_file: str) -> Iterator[None]:
    """Raise a StudyError that is raised inside with the name of the study's file."""
    try:
        yield
    except StudyError as error:
        if not study_file:
            raise
        placed = place_problems(error.problems, study_file)
        raise type(error)(*placed) from error
