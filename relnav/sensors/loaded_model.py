"""What every loaded model has: one line that says which it is, instead of all its values."""

from typing import Any


class LoadedModel:
    """A model of a file, whose dataclass fields are its sections; `sensor_type` is that of its file."""

    _sensor_type = ""

    def __init_subclass__(cls, sensor_type: str = "", **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls._sensor_type = sensor_type or cls._sensor_type

    def __repr__(self) -> str:
        """One line for the console."""
        model: Any = self
        values = "vars(model)" + (f", with sources: relnav models {model.path}" if model.path else "")
        return f"<{type(self).__name__} {model.name}, {self._sensor_type}: {model.title}; all values: {values}>"
