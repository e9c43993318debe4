# SPDX-License-Identifier: MIT
"""Checks the answer of the program about a scene with Python's own reader of TOML.

Accepted text must be TOML; each of its values must be the one in the complete scene; every number of the complete scene
must be in its range. Known differences between the two readers are listed in `tolerated`: newer TOML than Python knows.
"""

import math
import os
import re
import tomllib

INVALID_OPTION = -1
LETTERS = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")


def positive(value):
    return value > 0


def not_negative(value):
    return value >= 0


def tolerance(value):
    return 1e-15 <= value <= 1e-2


def unset_or_tolerance(value):
    return value == 0 or tolerance(value)


def below_a_right_angle(value):
    return abs(value) < math.pi / 2


def zero_or_normal(value):
    return value == 0 or abs(value) >= 1e-300


# Ranges of the complete scene: those of a key, for every model; they apply to all numbers of a list.
RANGES = {
    "model": dict.fromkeys(
        "mass inertia radius half_length stiffness wheel_radius rear_length half_track fork_forward fork_height".split(), positive
    )
    | {"damping": not_negative, "free_length": not_negative, "fork_angle": below_a_right_angle, "frequency": zero_or_normal},
    "initial": {
        "tilt": below_a_right_angle,
        "weights": positive,
        "velocity_weights": positive,
        "largest_move": not_negative,
        "largest_velocity_move": not_negative,
    },
    "solver": {"step": not_negative, "max_steps": positive, "max_events": positive, "secant_limit": lambda value: value > 1}
    | dict.fromkeys(["constraint_tolerance", "start_tolerance"], tolerance)
    | dict.fromkeys(["rtol", "rtol_qd", "utol", "Btol", "Htol", "intol"], unset_or_tolerance)
    | dict.fromkeys("atol atol_qd first_step max_step v_limit w_limit condition_limit iteration_limit".split(), not_negative)
    | dict.fromkeys(["max_evaluations", "max_seconds"], not_negative),
    "output": {"every": positive, "interval": not_negative},
}
#: The keys of fixed steps, and of steps under error control.
STEPS = ["stepper", "step", "rtol", "rtol_qd", "atol", "atol_qd", "first_step", "max_step"]
SINGLE = ["scene", "model", "initial", "time", "solver", "output"]
# Those of mechanisms, which have tables within them.
SINGLE += "parameters gravity ground body joint constraint wheel force function sensor results repeat".split()
# A message may show a line, mark a part of it, and name it.
LONGEST_MESSAGE = 100000
# More steps or rows than these are refused.
MOST = 2**31


def problem(case, path, verdict, status, text):
    """Problem in the answer; none if it is right."""
    try:
        said = text.decode()
    except UnicodeDecodeError:
        said = None if verdict == "accepted" else text.decode(errors="replace")
    if verdict == "refused":
        if case.kind.startswith("same "):
            return "a right scene was refused: " + said
        return wrong_message(case, path, status, said)
    if verdict != "accepted":
        return f"{verdict}, status {status}: {said[:2000]}"
    if case.kind.startswith("never "):
        return "a wrong scene was accepted"
    if said is None:
        return "the complete scene is no UTF-8"
    return wrong_scene(case, said)


# --- refused ----------------------------------------------------------------------------------------------------------


def wrong_message(case, path, status, message):
    # A start that asks for an equilibrium or a steady motion is looked for as the scene is read, and meets what runs meet.
    if status < INVALID_OPTION and re.search(rb"equilibrium|steady", case.text + os.fsencode(" ".join(case.settings))):
        return None
    if status != INVALID_OPTION:
        return f"refused with status {status}: {message}"
    if not message.strip() or message != message.rstrip():
        return f"a message that is empty or ends in blanks: {message!r}"
    if len(message) > LONGEST_MESSAGE:
        return f"a message of {len(message)} characters"
    if re.search("[\0-\x08\x0b-\x1f\x7f]", message):
        return f"a message with control characters: {message!r}"
    # The place: a line of the file, the file where something is missing, or the setting.
    place = re.search(r"--> (\S+):(\d+):(\d+)", message)
    if place and place[1] == str(path):
        lines = len(re.split(rb"\n", case.text))
        return None if 1 <= int(place[2]) <= lines + 1 else f"there is no line {place[2]}: {message}"
    if "--set" in message:
        return None if case.settings else f"blames a setting that there is not: {message}"
    if re.search(rf"{re.escape(str(path))}( with every default)? is not a valid scene: (line \d+|it has more than|there may be) ", message):
        return None
    if re.search(rf"(is missing in|-->) \[+\w+\]+ of {re.escape(str(path))}", message):
        return None
    return f"names no place: {message}"


# --- accepted ---------------------------------------------------------------------------------------------------------


def tolerated(text):
    """TOML 1.1 as 1.0: inline tables may end in a comma, and have ends of lines."""

    def joined(match):
        return re.sub(r",\s*\}", "}", match[0].replace("\n", " "))

    return re.sub(r"\{[^{}\"']*(?:\"[^\"\n]*\"[^{}\"']*)*\}", joined, text)


def parsed(text):
    """A text as read by Python, and its message if it fails."""
    try:
        return tomllib.loads(text), None
    except (tomllib.TOMLDecodeError, RecursionError) as first:
        try:
            return tomllib.loads(tolerated(text)), None
        except (tomllib.TOMLDecodeError, RecursionError):
            return None, f"Python says: {first}"


def setting(word):
    """A setting as a document: an invalid TOML value is a text."""
    word = word.rstrip(" ")
    document, why = parsed(word)
    value = word.split("=", 1)[1].strip(" ")
    if document is None and value[:1] not in ("'", '"', "[", "{"):
        for key in reversed(word.split("=", 1)[0].split(".")):
            value = {key: value}
        return value, None
    return document, why


def wrong_scene(case, text):
    try:
        shown = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        return f"the complete scene is no TOML: {error}"
    try:
        source = case.text.decode()
    except UnicodeDecodeError:
        return "no UTF-8 was accepted"
    # A mark of the order of bytes before the text is skipped here; Python's reader takes none.
    document, why = parsed(source.removeprefix("\ufeff"))
    if document is None:
        return f"what is no TOML was accepted. {why}"
    settings = []
    for word in case.settings:
        more, why = setting(os.fsencode(word).decode(errors="surrogateescape"))
        if more is None:
            return f"the setting {word!r} was accepted. {why}"
        settings.append(more)
    return wrong_values(document, settings, shown) or wrong_ranges(shown)


def wrong_values(document, settings, shown):
    """True if the complete scene differs from file and settings."""
    given, events = {}, []
    for source in [document, *settings]:
        for table, content in source.items():
            if table not in [*SINGLE, "event"]:
                return f"{table!r} was accepted, and is no table of a scene"
            if table != "event":
                merge(given.setdefault(table, {}), content)
            elif isinstance(content, list):
                events = [dict(event) for event in content]
            else:
                for number, event in content.items():
                    if not 1 <= int(number) <= len(events) + 1:
                        return f"a key of event {number} was accepted, and there are {len(events)}"
                    events[int(number) - 1 : int(number)] = [(events[int(number) - 1 : int(number)] or [{}])[0] | event]
    # A setting of one kind of steps replaces the keys of the other kind that the file has.
    replaced = [key for more in settings for key in more.get("solver", {}) if key in STEPS]
    for table, content in given.items():
        for key, value in content.items():
            if table == "solver" and replaced and key in STEPS and key not in replaced:
                continue
            if key not in shown.get(table, {}):
                if table == "initial" and "q" in given["initial"]:
                    continue
                return f"{key!r} in [{table}] was accepted, and left out"
            if not same(value, shown[table][key]):
                return f"{key} in [{table}] is {value!r}, and was taken for {shown[table][key]!r}"
    told = shown.get("event", [])
    if len(events) != len(told):
        return f"{len(events)} events were taken for {len(told)}"
    for event, other in zip(events, told):
        for key, value in event.items():
            if key not in other or not same(value, other[key]):
                return f"{key!r} of an event is {value!r}, and was taken for {other.get(key)!r}"
    return None


def merge(tables, more):
    """Later values replace earlier ones, key by key in tables within tables."""
    for key, value in more.items():
        if isinstance(value, dict) and isinstance(tables.get(key), dict):
            merge(tables[key], value)
        else:
            tables[key] = value


def same(value, shown):
    """True if a value equals the displayed one: numbers to the last bit, texts up to trailing blanks."""
    if isinstance(value, dict):
        return isinstance(shown, dict) and all(key in shown and same(one, shown[key]) for key, one in value.items())
    if isinstance(shown, list) and not isinstance(value, (list, dict)):
        return len(shown) > 0 and all(same(value, one) for one in shown)
    if isinstance(value, list):
        return isinstance(shown, list) and len(value) == len(shown) and all(map(same, value, shown))
    if isinstance(shown, bool) or isinstance(value, bool):
        return value is shown
    if isinstance(shown, (int, float)):
        if isinstance(value, int) and isinstance(shown, float):
            return abs(value) < 2**63 and float(value) == shown
        return isinstance(value, (int, float)) and value == shown
    if isinstance(shown, str):
        return isinstance(value, str) and value.rstrip(" ") == shown.rstrip(" ")
    return False


def numbers(value):
    """All numbers of a value, however deep."""
    if isinstance(value, (list, tuple)):
        return [number for one in value for number in numbers(one)]
    if isinstance(value, dict):
        return numbers(list(value.values()))
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def wrong_ranges(shown):
    """True if a number of the complete scene is not a number or out of its range."""
    if not all(math.isfinite(number) for number in numbers(shown)):
        return "the complete scene has numbers that are not finite"
    for table, ranges in RANGES.items():
        for key, is_right in ranges.items():
            for number in numbers(shown.get(table, {}).get(key, [])):
                if not is_right(number):
                    return f"{key} = {number} in [{table}] was accepted"
    if not shown["time"]["end"] > shown["time"]["start"]:
        return "a run that ends before it starts was accepted"
    if not LETTERS.fullmatch(shown["scene"]["name"]):
        return f"the name {shown['scene']['name']!r} was accepted"
    span = shown["time"]["end"] - shown["time"]["start"]
    solver = shown["solver"]
    if not numbers([solver["rtol"], solver.get("rtol_qd", 0)]) != [0, 0] and solver["step"] and span / solver["step"] > MOST:
        return f"{span / solver['step']:g} steps were accepted"
    if shown["output"]["interval"] and span / shown["output"]["interval"] > MOST:
        return f"{span / shown['output']['interval']:g} rows were accepted"
    return None
