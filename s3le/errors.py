"""Every refusal of the library: one line each that says what, where, how much and what next."""

LONGEST = 4000  # characters of a refusal


class S3leError(Exception):
    """Base of every error this project raises on purpose.

    Its text is one printable line of bounded length, whatever a file put into it.
    """

    def __str__(self) -> str:
        """The text; what does not print is escaped, what is too long loses its middle."""
        text = _shortened(super().__str__())
        return _shortened("".join(c if c.isprintable() else ascii(c)[1:-1] for c in text))


def _shortened(text: str) -> str:
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[: half - 3]} ... {text[2 - half :]}"


class ParameterError(S3leError):
    """A parameter is missing, misspelt, of the wrong type or out of its range."""


class ClipError(S3leError):
    """A motion clip cannot be read; names the file, the place in it and the reason."""


class FetchError(S3leError):
    """A clip could not be obtained or is not the file that was asked for."""


class RobotError(S3leError):
    """A robot description is unusable: file, field, value, and what is wanted."""


class TableError(S3leError):
    """A table is missing, of another schema or robot, or breaks one of its named rules."""


class CertificateError(S3leError):
    """A pose that should be feasible is not, by the independent check."""


class StateError(S3leError):
    """A robot is not where it should be, or its state is another robot's: joint, how far."""


class TrainingError(S3leError):
    """A training cannot go on: no data, a loss that is not finite, a foreign checkpoint."""


class ModelError(S3leError):
    """A stored model cannot be used: missing, damaged, or made for another robot."""


class EngineError(S3leError):
    """A table cannot be made in shards: another writer, lost workers, a foreign machine."""


class TrajectoryError(S3leError):
    """A robot's trajectory cannot be read or used: file, row or line, value, and what is wanted."""


class BundleError(S3leError):
    """An exported retargeter cannot be used: a piece is missing, damaged, or of another one."""


class FilmError(S3leError):
    """A picture or film cannot be made, or a viewer not opened: what is missing, what to do."""


class VideoError(S3leError):
    """A video cannot be read, or its people not be estimated: file, frame, reason, what to do."""
