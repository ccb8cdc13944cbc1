"""Reading of case files by the scripts; the programs themselves validate them."""
import sys
import tomllib


def load(path, overrides=()):
    """The case as nested dictionaries, with `overrides` ("table.key=VALUE") applied."""
    try:
        settings = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError:
        return {"run": {}, "fluid": {}, "solid": {}} if "[fluid" in path.read_text() else {"run": {}}
    except OSError as error:
        sys.exit(f"error: {error}")
    for override in overrides:
        key, _, text = override.partition("=")
        try:
            value = tomllib.loads(f"v = {text}")["v"]
        except tomllib.TOMLDecodeError:
            value = text
        table = settings
        *path_to, last = key.strip().split(".")
        for name in path_to:
            if isinstance(table, list):
                table = table[int(name)] if name.isdigit() and int(name) < len(table) else {}
            else:
                table = table.setdefault(name, {})
        if isinstance(table, dict):
            table[last] = value
    return settings


def value_of(settings, dotted):
    """settings["a"]["b"] for "a.b", or None."""
    for name in dotted.split("."):
        settings = settings.get(name) if isinstance(settings, dict) else None
    return settings
