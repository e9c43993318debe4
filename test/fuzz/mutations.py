# SPDX-License-Identifier: MIT
"""Makes scenes that are wrong, odd, or right in an unusual way, from a seeded generator of random numbers.

Each kind of input is a function of (random, texts) that gives a text as str or bytes; in `KINDS` with its share. A kind that is
named `same ...` only changes the spelling: it must be accepted. One that is named `never ...` must be refused.
"""

import re
from dataclasses import dataclass, field

import mechanisms


@dataclass
class Case:
    """A scene file and settings of the command line."""

    kind: str
    text: bytes
    settings: list = field(default_factory=list)


# --- the raw material -------------------------------------------------------------------------------------------------

NUMBERS = """0 -0 +0 0.0 -0.0 1 -1 +1 2 7 100 1e0 1E+3 1e-3 -1e-3 1e300 -1e300 1e308 1.8e308 1e309 -1e400 1e-300 1e-308 5e-324
    1e-400 2147483647 2147483648 -2147483648 4294967296 9223372036854775807 9223372036854775808 -9223372036854775808
    -9223372036854775809 18446744073709551615 18446744073709551617 999999999999999999 123456789012345678901234567890
    0x10 0xff 0xFFFFFFFFFFFFFFFF 0x7fffffffffffffff 0x8000000000000000 0x0000000000000000000001 0o17 0o777777777777777777777
    0b101 0b1111111111111111 -0x10 1_000 1__000 _1 1_ 1_000.5 1._5 1.5_ 1e1_0 1e_1 0.1e1_ .5 5. 5.e3 1e 1e+ -e1 +-1 --1 00 01 -01
    1.0.0 nan +nan -nan inf +inf -inf NaN Infinity INF infinity 1,5 1.5d0 1.5f 0x1p3 1e5.5 3.141592653589793238462643383279502884197
    0.1000000000000000055511151231257827 179769313486231570814527423731704356798070e267 2.2250738585072011e-308
    4.9406564584124654e-324 1.7976931348623157e308 1.7976931348623159e308""".split()

VALUES = [
    "true",
    "false",
    "True",
    "tru",
    "1979-05-27",
    "1979-05-27T07:32:00Z",
    "1979-05-27 07:32:00.999999-07:00",
    "07:32:00",
    "07:32",
    "1979-13-99",
    "[]",
    "[[]]",
    "[1]",
    "[1.0, 2.0, 3.0]",
    "[1, 2.5, 3]",
    "[5.0, 2.5, nan]",
    "[1.0, -1.0, 0.0]",
    "[1, 2, 3, 4, 5, 6, 7, 8, 9]",
    "[1, 'a', true]",
    '["q", "q"]',
    '["q", "qdd"]',
    "[1.0, 2.0",
    "1.0, 2.0]",
    "[1.0 2.0]",
    "[,]",
    "[1.0,,2.0]",
    "[1.0, 2.0, 3.0,]",
    "{}",
    "{ a = 1 }",
    "{ a = 1, }",
    "{ a = 1, a = 2 }",
    "{ a.b = 1, a.c = 2 }",
    "{",
    "}",
    '""',
    "''",
    '"a"',
    "'a'",
    '"""a"""',
    "'''\na'''",
    '"""a\\\n"""',
    '"""a \\  \n\n  b"""',
    '"""a\\"""',
    '"""\\""""""',
    '"\\u001b[31m"',
    '"',
    "'",
    '"""',
    '"\\n"',
    '"\\x41"',
    '"\\e"',
    '"\\u0041"',
    '"\\u00e9"',
    '"\\ud800"',
    '"\\U00110000"',
    '"\\U0001F600"',
    '"\\q"',
    '"\\',
    '"rk4"',
    '"RK4"',
    '"rk4 "',
    '" rk4"',
    '"dopri5"',
    '"sdirk54"',
    '"trapezoid"',
    '"rk4\\u0000"',
    '"../../x"',
    '"/"',
    '"é"',
    '"日本語"',
    "rk4",
    "é",
    "#",
    "= 1",
    "",
    "1 2",
    "1 # two",
    "1\t",
    "1;",
    "$HOME",
    "%s%s%n",
    "\\",
    '"' + "x" * 300 + '"',
    '"' + "x" * 20000 + '"',
    "1" * 400,
    "0." + "1" * 4000,
    "1e" + "9" * 50,
    "0x" + "f" * 40,
    "[" * 60 + "]" * 60,
    "[" + "1.0, " * 500 + "]",
]

TABLE_OF = {"description": "scene", "mass": "model", "omega": "initial", "q": "initial", "fields": "output"}
TABLES = ["scene", "model", "initial", "time", "solver", "output", "event"]
# Some of mechanisms, whose tables have tables within them.
TABLES += ["parameters", "gravity", "body", "body.bob", "body.rod", "joint", "joint.pin", "joint.guide", "force", "sensor.tip", "repeat.bay"]
OTHER_KEYS = ["", "a" * 500, '"\\u001b[2J"', '"\\n"', '"a b"', '"\\x41"']
OTHER_KEYS += "x Mass massa é \"step\" 'step' step.size solver.step 1 - _".split()
CONTROLS = [bytes([code]) for code in (*range(0, 9), *range(11, 32), 127)]
BROKEN = [bytes.fromhex(code) for code in "80 ff c0af e282 eda080 f4908080 f888808080 c3 e9".split()]
ENDS = [["\r"], ["\r\n", "\n"], ["\n\r"], ["\n", "\n", "\r"], ["\r\r\n", "\n"], ["\x0b"], ["\x0c\n", "\n"], ["\u2028"]]
SYNTAX = """[ ] { } = . , " ' # \n \"\"\" ''' a 1 - 1.5 true""".split(" ")
PAIR = re.compile(r"^([A-Za-z0-9_]+)( *= *)([^#\n]*?)( *(?:#.*)?)$")


def pairs(lines):
    """Indices of the lines `key = value` with a value that ends on the line."""
    return [i for i, line in enumerate(lines) if PAIR.match(line) and line.count("[") == line.count("]") and "'''" not in line]


def heads(lines):
    return [i for i, line in enumerate(lines) if line.startswith("[")]


def keys_of(texts):
    """(table, key) of all scenes."""
    found = []
    for text in texts:
        table = ""
        for line in text.split("\n"):
            if line.startswith("["):
                table = line.strip("[]")
            elif match := PAIR.match(line):
                found.append((table, match[1]))
    return [pair for pair in found if pair[0] in TABLES and pair[0] != "event"]


def any_value(random):
    return random.choice(NUMBERS) if random.random() < 0.6 else random.choice(VALUES)


# --- the kinds --------------------------------------------------------------------------------------------------------


def bytes_changed(random, texts):
    """Some bytes flipped, removed, doubled, inserted."""
    data = bytearray(random.choice(texts).encode())
    for _ in range(random.choice([1, 1, 1, 2, 5, 20])):
        at = random.randrange(len(data))
        what = random.randrange(4)
        if what == 0:
            data[at] ^= 1 << random.randrange(8)
        elif what == 1:
            del data[at : at + random.choice([1, 1, 2, 10])]
        elif what == 2:
            data[at:at] = data[at : at + random.choice([1, 2, 10, 50])]
        else:
            data[at:at] = bytes([random.choice(b"[]{}=.,\"'#\\\n\r\t -+_0123456789eE" + bytes([random.randrange(256)]))])
        if not data:
            break
    return bytes(data)


def truncated(random, texts):
    data = random.choice(texts).encode()
    return data[: random.randrange(len(data))]


def spliced(random, texts):
    """The beginning of one scene, the end of another."""
    one, two = random.choice(texts), random.choice(texts)
    return one[: random.randrange(len(one))] + two[random.randrange(len(two)) :]


def lines_changed(random, texts):
    """Lines removed, doubled, moved, joined."""
    lines = random.choice(texts).split("\n")
    for _ in range(random.choice([1, 1, 2, 4])):
        at, to = random.randrange(len(lines)), random.randrange(len(lines))
        what = random.randrange(5)
        if what == 0 and len(lines) > 1:
            del lines[at]
        elif what == 1:
            lines.insert(to, lines[at])
        elif what == 2:
            lines[at], lines[to] = lines[to], lines[at]
        elif what == 3:
            lines[at] += random.choice(["", " ", ", "]) + lines[to]
        else:
            cut = random.randrange(len(lines[at]) + 1)
            lines[at : at + 1] = [lines[at][:cut], lines[at][cut:]]
    return "\n".join(lines)


def keys_missing(random, texts):
    """One key of a scene is missing, or one table with all of its keys."""
    lines = (mechanisms.mechanical(random, texts, wild=False) if random.random() < 0.6 else random.choice(texts)).split("\n")
    if random.random() < 0.8:
        del lines[random.choice(pairs(lines))]
    else:
        places = heads(lines)
        at = random.choice(places)
        del lines[at : min([place for place in places if place > at], default=len(lines))]
    return "\n".join(lines)


def keys_changed(random, texts):
    lines = random.choice(texts).split("\n")
    at = random.choice(pairs(lines))
    match = PAIR.match(lines[at])
    key = random.choice(OTHER_KEYS) if random.random() < 0.5 else random.choice(keys_of(texts))[1]
    if random.random() < 0.2:
        key = key + "." + match[1]
    lines[at] = key + lines[at][len(match[1]) :]
    return "\n".join(lines)


def values_changed(random, texts):
    lines = random.choice(texts).split("\n")
    for at in random.sample(pairs(lines), random.choice([1, 1, 2])):
        match = PAIR.match(lines[at])
        lines[at] = match[1] + match[2] + any_value(random) + match[4]
    return "\n".join(lines)


def numbers_changed(random, texts):
    """A number of the text becomes another one, mostly a number that a program may take."""
    text = random.choice(texts)
    places = list(re.finditer(r"(?<![\w.\"'])-?\d[\d_.]*(?:e[-+]?\d+)?(?![\w\"'])", text))
    for match in sorted(random.sample(places, random.choice([1, 1, 2, 3])), key=lambda match: -match.start()):
        if random.random() < 0.3:
            number = random.choice(NUMBERS)
        else:
            value = random.choice([1, 1, 1, -1]) * random.random() * 10.0 ** random.randint(-320, 308)
            number = f"{value:.{random.randrange(1, 18)}g}"
        text = text[: match.start()] + number + text[match.end() :]
    return text


def keys_added(random, texts):
    """A key of any table, in any table, with the value that another scene gives, or any other."""
    lines = random.choice(texts).split("\n")
    table, key = random.choice(keys_of(texts))
    at = random.choice(heads(lines))
    if random.random() < 0.7:
        own = [i for i in heads(lines) if lines[i] == f"[{table}]"]
        at = own[0] if own else at
    lines.insert(at + 1, f"{key} = {any_value(random)}")
    return "\n".join(lines)


def tables_changed(random, texts):
    """Headings swapped, doubled, renamed, nested, of another kind."""
    lines = random.choice(texts).split("\n")
    for _ in range(random.choice([1, 1, 2])):
        at = random.choice(heads(lines))
        name = lines[at].strip("[]")
        other = random.choice(TABLES)
        lines[at] = random.choice(
            [
                f"[{other}]",
                f"[[{other}]]",
                f"[[{name}]]",
                f"[{name}.{other}]",
                f"[ {name} ]",
                f"['{name}']",
                f'["{name}"]',
                f"[{name}]]",
                f"[[{name}]",
                f"[{name}",
                f"{name}]",
                "[]",
                "[[]]",
                "[.]",
                f"[{name}.]",
                f"[.{name}]",
                f"[{name}]\n[{name}]",
                f"[{name}]\n[{other}]",
                f"{name} = {{}}",
                f"{name} = []",
                f"{name} = 1",
                f"[{name}] # why",
                f"[{name}] x = 1",
                f"[ [{name}]]",
                f"[[{name}] ]",
                f"[[{name}]]\n[{name}.{other}]",
                "",
            ]
        )
    return "\n".join(lines)


def line_ends_changed(random, texts):
    """Lone carriage returns, mixed ends."""
    data = random.choice(texts)
    ends = random.choice(ENDS)
    return "".join(line + random.choice(ends) for line in data.split("\n"))


def characters_put_in(random, texts):
    """UTF-8, valid and broken, other encodings, control characters, at any place."""
    text = random.choice(texts)
    data = text.encode()
    what = random.randrange(6)
    at = random.randrange(len(data) + 1)
    if what == 0:
        return data[:at] + random.choice(CONTROLS) + data[at:]
    if what == 1:
        return data[:at] + random.choice(BROKEN) + data[at:]
    if what == 2:
        extra = random.choice(["é", "日本", "😀", "\u202e", "\ufeff", "\u00a0", "\u0085", "ß", "\u2212"])
        return data[:at] + extra.encode() + data[at:]
    if what == 3:
        return b"\xef\xbb\xbf" + data
    if what == 4:
        return text.encode(random.choice(["utf-16", "utf-16-le", "utf-32", "utf-7", "cp037"]))
    return text.replace("#", "# é ").encode("latin-1")


def garbage(random, texts):
    """Nothing, blanks, noise, other languages."""
    what = random.randrange(8)
    if what == 0:
        return random.choice([b"", b" ", b"\t\n", b"# only", b"\xef\xbb\xbf", b"\0", b"\\", *map(str.encode, SYNTAX)])
    if what == 1:
        return bytes(random.randrange(256) for _ in range(random.choice([1, 10, 100, 3000])))
    if what == 2:
        return "".join(random.choice("[]{}=.,\"'#\n ab1-") for _ in range(random.choice([5, 20, 200, 2000])))
    if what == 3:
        return random.choice(["", " "]).join(random.choices(SYNTAX, k=200))
    if what == 4:
        return '{"scene": {"model": "rolling_disk"}, "time": {"end": 1}}'
    if what == 5:
        return "<?xml version='1.0'?>\n<scene model='rolling_disk'/>\n"
    if what == 6:
        return b"\x89HDF\r\n\x1a\n" + bytes(random.randrange(256) for _ in range(500))
    return b"\x7fELF\x02\x01\x01" + bytes(500)


def nested(random, texts):
    """Nested arrays and tables, and dotted keys, up to a depth at which a recursive parser would fail."""
    text = random.choice(texts)
    depth = random.choice([2, 10, 100, 1000, 4000, 4999, 5001, 20000, 200000])
    opened = random.choice(["[", "{a=", "[{a=", "[[", "a.", "'a'.", '"".', "{a.b="])
    shut = {"[": "]", "{a=": "}", "[{a=": "}]", "[[": "]]", "{a.b=": "}"}.get(opened, "")
    if opened.endswith("."):
        more = random.choice(["{}a = 1", "[{}a]", "[[{}a]]", "x = {{ {}a = 1 }}"]).format(opened * depth)
    elif random.random() < 0.3:
        more = "\n".join("x%d = %s1%s" % (i, opened * 50, shut * 50) for i in range(min(depth, 200)))
    else:
        more = "x = " + opened * depth + random.choice(["", "1" + shut * depth, "1" + shut * (depth - 1)])
    return random.choice([f"{text}\n{more}\n", f"{more}\n{text}", more])


def huge(random, texts):
    """Up to some megabytes: lines, keys, texts, arrays, comments, tables, values."""
    text = random.choice(texts)
    n = random.choice([1000, 9000, 30000, 100000, 250000, 1000000, 3000000])
    lines = text.split("\n")
    scattered = ",\n" if random.random() < 0.5 else ", "
    events = "".join(f'\n[[event]]\nname = "e{i}"\nwatch = "rz"\n' for i in range(n // 40))
    listed = ", ".join(f'{{ name = "e{i}", watch = "rz" }}' for i in range(n // 40))
    more = random.choice(
        [
            "# " + "x" * n,
            "# x\n" * (n // 4),
            "x" * n + " = 1",
            'description = "' + "x" * n + '"',
            "description = '''\n" + "x" * n + "'''",
            'description = """' + ("x" * 100 + "\\\n") * (n // 100) + 'x"""',
            "x = '''" + "x\n" * (n // 2) + "'''",
            "omega = [" + f"1.0{scattered}" * (n // 5) + "]",
            "q = [" + f"1.0{scattered}" * (n // 5) + "]",
            "fields = [" + f'"q"{scattered}' * (n // 5) + "]",
            "fields = [" + f'"nonsense"{scattered}' * (n // 12) + "]",
            "\n".join(f"x{i} = 1" for i in range(n // 10)),
            "x = { " + ", ".join(f"x{i} = 1" for i in range(n // 10)) + " }",
            "mass = " + "1" * n,
            "mass = 1." + "0" * n + "1",
            "\n" * n,
            " " * n,
            events,
            "".join(f"\n[x{i}]\n" for i in range(n // 8)),
            bytes(n),
            bytes(random.randrange(256) for _ in range(1000)) * (n // 1000),
            b"\xff" * n,
            b"[" * n,
            b"\r\n" * n,
        ]
    )
    if isinstance(more, bytes):
        return more
    if more is events:
        return random.choice([text + events, f"event = [{listed}]\n{text}"])
    own = [i for i in heads(lines) if lines[i] == f"[{TABLE_OF.get(more.split(' ')[0], '')}]"] or heads(lines)
    key = more.split(" ")[0]
    lines.insert(own[0] + 1, more)
    return "\n".join(line for i, line in enumerate(lines) if i == own[0] + 1 or not line.startswith(f"{key} ="))


# --- texts from a grammar ---------------------------------------------------------------------------------------------

# Few names, so that they meet.
NAMES = ["a", "b", "solver", "step", "model", "event", "name", '"a"', "'a'", '"a.b"', "1", "''"]


def a_path(random):
    """A key of one or several names."""
    dot = random.choice([".", ".", " . ", "\t.", ". "])
    return dot.join(random.choices(NAMES, k=random.choice([1, 1, 1, 2, 2, 3, 5])))


def a_value(random, broken, depth=0):
    """A number, a text, an array that may go over several lines, an inline table."""
    what = random.randrange(10) if depth < 4 else 0
    if what < 5:
        return random.choice(["1", "0.5", "true", '"rk4"', "'x'", "1979-05-27", '"""\n[a.b]\n"""', "'''[[a]]'''",
                              any_value(random) if broken else "-2e3"])
    if what < 8:
        items = [a_value(random, broken, depth + 1) for _ in range(random.choice([0, 1, 1, 2, 3]))]
        comma = random.choice([", ", ",", " ,\n", ", # [a.b]\n"])
        last = random.choice(["]", " ]", "\n]", ",]", ",\n\n]"]) if items or broken else "]"
        return random.choice(["[", "[ ", "[\n"]) + comma.join(items) + last
    pairs_of = [f"{a_path(random)} = {a_value(random, broken, depth + 1)}" for _ in range(random.choice([0, 1, 1, 2, 3]))]
    first, last = (random.choice(["{", "{\n"]), random.choice(["}", ", }"])) if broken else ("{ ", " }")
    return first + ", ".join(pairs_of) + last


def a_heading(random, broken):
    opened, shut = random.choice([("[", "]"), ("[[", "]]"), ("[ ", " ]"), ("[[ ", " ]]")])
    if broken and random.random() < 0.1:
        opened, shut = random.choice([("[", "]]"), ("[[", "]"), ("[", "")])
    end = random.choice([" x = 1", ".b", "]"]) if broken and random.random() < 0.1 else random.choice(["", "", " # [a.b]"])
    return random.choice(["", "", " ", "\t"]) + opened + a_path(random) + shut + end


def grammatical(random, texts):
    """Tables, arrays of tables, dotted keys, arrays and inline tables that extend, repeat and contradict each other."""
    lines = []
    broken = random.random() < 0.3
    for _ in range(random.choice([1, 2, 2, 3, 5, 10, 30])):
        if random.random() < 0.45:
            lines.append(a_heading(random, broken))
        else:
            lines.append(f"{a_path(random)} = {a_value(random, broken)}" + random.choice(["", "", " # why", " x" if broken else ""]))
    if random.random() < 0.3:
        lines.insert(random.randrange(len(lines) + 1), random.choice(texts))
    return random.choice(["\n", "\n", "\n\n", "\r\n"]).join(lines) + random.choice(["", "\n"])


# --- right, though unusual --------------------------------------------------------------------------------------------


def same_line_ends(random, texts):
    """As written by a Windows editor, or without an end of the last line."""
    text = random.choice([text for text in texts if "'''" not in text])
    return random.choice([text.replace("\n", "\r\n"), text.rstrip("\n"), text.rstrip("\n").replace("\n", "\r\n"), text + "\n\n\n"])


def same_comments(random, texts):
    """Comments, blanks and empty lines, in any script."""
    lines = random.choice([text for text in texts if "'''" not in text]).split("\n")
    more = ["", "  \t", "# é 日本 😀", "#", "\t# [x] = '", "# " + "x" * 2000]
    for _ in range(random.choice([1, 5, 20])):
        lines.insert(random.randrange(len(lines) + 1), random.choice(more))
    return "\n".join(lines)


def same_numbers(random, texts):
    """Numbers in another notation."""

    def other(match):
        value = float(match[2])
        if random.random() < 0.5:
            return match[0]
        signed = repr(value) if value < 0 else f"+{value!r}"
        whole = f"{int(value):_}.0" if value == int(value) else repr(value)
        digits = f"{value:.25f}" if value > 1e-3 else repr(value)
        return match[1] + random.choice([repr(value), f"{value:.17e}", digits, signed, whole])

    return re.sub(r"(= *)(-?\d+\.\d*(?:e-?\d+)?|\d+e-?\d+)(?=\s|$)", other, random.choice(texts))


def same_keys(random, texts):
    """Keys and headings in quotes, with blanks, tables in another order, tables as dotted keys."""
    text = random.choice([text for text in texts if "'''" not in text])
    what = random.randrange(4)
    if what == 0:
        return re.sub(r"(?m)^(\w+) *=", lambda match: random.choice(['"%s" =', "'%s'\t=", " %s=", "%s ="]) % match[1], text)
    if what == 1:
        return re.sub(r"(?m)^\[(\w+)\]", lambda match: random.choice(["[ %s ]", "['%s']", '  ["%s"]', "[\t%s ]"]) % match[1], text)
    blocks = re.split(r"(?m)^(?=\[)", text)
    first, tables = blocks[0], [block for block in blocks[1:] if not block.startswith("[[")]
    events = [block for block in blocks[1:] if block.startswith("[[")]
    if what == 2:
        random.shuffle(tables)
        return first + "\n".join(tables + events)
    plain = [block for block in tables if all(line == "" or line[0] in "#[" or PAIR.match(line) for line in block.split("\n"))]
    # A table whose dotted keys continue in other headings would be another scene.
    tops = [re.match(r"\[(\w+)", block)[1] for block in tables]
    plain = [block for block in plain if tops.count(re.match(r"\[(\w+)", block)[1]) == 1]
    chosen = random.choice(plain)
    name = re.match(r"\[([\w.]+)\]", chosen)[1]
    dotted = re.sub(r"(?m)^(\w+) *=", rf"{name}.\1 =", chosen.split("\n", 1)[1])
    return first + dotted + "\n" + "\n".join([block for block in tables if block is not chosen] + events)


def never_control(random, texts):
    """A control character anywhere: TOML allows none but tabs and ends of lines."""
    data = random.choice(texts).encode()
    at = random.randrange(len(data) + 1)
    return data[:at] + random.choice([code for code in CONTROLS if code != b"\r"]) + data[at:]


def never_broken(random, texts):
    """Invalid UTF-8, anywhere."""
    data = random.choice([text for text in texts if text.isascii()]).encode()
    at = random.randrange(len(data) + 1)
    return data[:at] + random.choice(BROKEN) + data[at:]


def never_doubled(random, texts):
    """A repeated key or table."""
    lines = random.choice([text for text in texts if "\n[[" not in text]).split("\n")
    if random.random() < 0.7:
        at = random.choice(pairs(lines))
        lines.insert(at, lines[at])
    else:
        lines.append(lines[random.choice(heads(lines))])
    return "\n".join(lines)


KINDS = [
    ("bytes", 14, bytes_changed),
    ("truncated", 5, truncated),
    ("spliced", 5, spliced),
    ("lines", 9, lines_changed),
    ("keys", 6, keys_changed),
    ("keys missing", 8, keys_missing),
    ("values", 12, values_changed),
    ("numbers", 14, numbers_changed),
    ("keys added", 6, keys_added),
    ("tables", 6, tables_changed),
    ("line ends", 2, line_ends_changed),
    ("characters", 5, characters_put_in),
    ("garbage", 3, garbage),
    ("grammar", 20, grammatical),
    ("mechanisms", 20, mechanisms.mechanical),
    ("nested", 1.5, nested),
    ("huge", 1.0, huge),
    ("same line ends", 1, same_line_ends),
    ("same comments", 1.5, same_comments),
    ("same numbers", 1.5, same_numbers),
    ("same keys", 2, same_keys),
    ("never control", 1, never_control),
    ("never broken", 1, never_broken),
    ("never doubled", 1, never_doubled),
]
# Settings of the command line with a scene that is right, in parts of all those.
SETTINGS_SHARE = 0.14


# --- settings of the command line -------------------------------------------------------------------------------------


def an_event(random):
    """Events as settings give them: one by its number, all of them, and nearly so."""
    keys = {"name": ['"a"', "b", '""', "1"], "watch": ["rz", '"qd:rz"', "x1", "'lambda:contact height'", "no"],
            "value": ["0.5", "1e300", "nan", "x"], "direction": ["rising", '"both"', "up"], "action": ["stop", "explode"], "x": ["1"]}
    if random.random() < 0.6:
        key = random.choice(list(keys))
        number = random.choice("1 1 1 2 3 0 -1 01 1.5 x 99999999999999999999".split())
        return f"event.{number}.{key}={random.choice(keys[key])}"
    tables = []
    for _ in range(random.choice([0, 1, 1, 2, 5])):
        some = random.sample(list(keys), random.choice([0, 2, 3])) if random.random() < 0.3 else ["name", "watch", "value"]
        tables.append("{" + ", ".join(f"{key} = {random.choice(keys[key])}" for key in some) + "}")
    if random.random() < 0.7:
        tables = [re.sub(r"(name|watch) = (\w+)([,}])", r'\1 = "\2"\3', table) for table in tables]
    return f"event{random.choice(['', '', '.1', ' '])}=[{', '.join(tables)}]"


def a_setting(random, texts):
    table, key = random.choice(keys_of(texts))
    value = any_value(random)
    if random.random() < 0.3:
        value = random.choice('1.0 1e-3 10 dopri5 "dopri5" sdirk54 adaptive abc disk_2 [1,2,3] true'.split())
    word = f"{table}.{key}={value}"
    what = random.randrange(26)
    if what > 23:
        word = f"{random.choice(TABLES)}={a_value(random, True)}"
    elif what > 19:
        word = an_event(random)
    elif what == 0:
        word = random.choice("= . .= a.b a=1 solver.step solver.=1 .step=1 solver.step==1 --set a.b.c=1".split())
    elif what == 1:
        at = random.randrange(len(word) + 1)
        word = word[:at] + random.choice(list("=.[]{}\"'#\\ \t,é😀\x01\x7f") + ["\udcff"]) + word[at:]
    elif what == 2:
        word = word.replace(".", random.choice([" . ", "..", ".x."]), 1)
    elif what == 3:
        word = word.replace("=", random.choice([" = ", "= ", ":", "=="]), 1)
    elif what == 4:
        word = f"{random.choice(TABLES)}.{random.choice(OTHER_KEYS)}={value}"
    elif what == 5:
        word += random.choice([" # comment", " x", ",", "]", "}", '"', "'"])
    return word.replace("\n", " ").replace("\r", " ").replace("\0", " ")


def cases(texts, random, count, only=None):
    """(number, case) a number of times, of one kind if it is given; the scenes themselves first."""
    for number, text in enumerate(texts, 1):
        yield number, Case("same scene", text.encode())
    kinds = [*KINDS, ("settings", sum(share for _, share, _ in KINDS) * SETTINGS_SHARE, None)]
    shares = [share * (only in (None, kind)) for kind, share, _ in kinds]
    for number in range(len(texts) + 1, count + 1):
        kind, _, change = random.choices(kinds, shares)[0]
        if change:
            text = change(random, texts)
            yield number, Case(kind, text if isinstance(text, bytes) else text.encode("utf-8", "surrogateescape"))
        else:
            words = [a_setting(random, texts) for _ in range(random.choice([1, 1, 1, 2, 4]))]
            yield number, Case(kind, random.choice(texts).encode(), words)
