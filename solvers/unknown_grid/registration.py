"""Registration of the environments with Gymnasium. It imports neither Gymnasium nor the environments."""

from __future__ import annotations

from ...errors import BackendMissing

__all__ = ["ID", "register"]

#: Name of the environments in Gymnasium's registry.
ID = "crosstrack/UnknownGrid-v0"


def register() -> None:
    """Register ``crosstrack/UnknownGrid-v0`` for ``gymnasium.make`` and ``gymnasium.make_vec``.

    Gymnasium calls this function itself if crosstrack is installed as a distribution.

    Raises
    ------
    BackendMissing
        Gymnasium is not installed: ``pip install 'crosstrack[learn]'``.
    """
    try:
        from gymnasium import envs
    except ImportError as error:
        text = f"{ID} needs gymnasium: pip install 'crosstrack[learn]'"
        raise BackendMissing(text) from error

    home = __name__.rpartition(".")[0]
    if ID not in envs.registry:
        envs.register(
            ID,
            entry_point=f"{home}.gymnasium:UnknownGridEnv",
            vector_entry_point=f"{home}.vector:UnknownGridVectorEnv",
        )
