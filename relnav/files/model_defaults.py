"""Values that a mission file may leave out, each with the reason why it fits: they are shown as if they stood in it."""

import dataclasses
from typing import Any

DEFAULTS: dict[str, dict[str, dict[str, Any]]] = {
    "process_noise": {
        "acceleration_noise_density_m2_s3": {
            "value": 1e-10,
            "source": "assumed",
            "why": "left out: Clohessy-Wiltshire's error at e = 0.008, 1.3e-6 m/s^2 that persists for the filter's "
            "memory of 22 to 50 s, rounded up",
        }
    },
    "filter": {
        "initial_velocity_sigma_m_s": {
            "value": 0.1,
            "source": "assumed",
            "why": "left out: final approaches fly at up to 0.1 m/s (Fehse, ch. 2)",
        }
    },
}
"""Section -> key -> value with its source."""


def add_defaults(table: dict[str, Any], sections: dict[str, Any]) -> None:
    """Put DEFAULTS into a parsed file where its sections have such a key and it is not there in any unit."""
    from relnav.files.toml_values import find_field

    for section, values in DEFAULTS.items():
        if section not in sections or not isinstance(entries := table.setdefault(section, {}), dict):
            continue
        names = [field.name for field in dataclasses.fields(sections[section])]
        given = {find_field(key, names)[0] for key in entries}
        for key, value in values.items():
            if key in names and key not in given:
                entries[key] = dict(value)
