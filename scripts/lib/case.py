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
                named = next((entry for entry in table if isinstance(entry, dict) and entry.get("name") == name), {})
                table = table[int(name)] if name.isdigit() and int(name) < len(table) else named
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


def parts(settings):
    """{role: table} of what is coupled: "fluid", and "solid" or the names of several [[solid]]."""
    found = {"fluid": settings["fluid"]} if "fluid" in settings else {}
    tables = settings.get("solid", [])
    if isinstance(tables, dict):
        return {**found, "solid": tables}
    return {**found, **{table.get("name", "solid"): table for table in tables}}


def by_part(settings):
    """The case with each of several [[solid]] as a table of its own name."""
    return {**{key: table for key, table in settings.items() if key != "solid"}, **parts(settings)}
