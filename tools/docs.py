#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the reference of the library, build/docs/index.html, from the comments of the sources and the pages of doc/.

Usage: tools/docs.py

Prints "ok NAME" or "not ok NAME" for each check: every public entity has a comment, FORD has nothing to warn of, and every
link between the pages leads somewhere. The exit code is 1 if anything failed. Needs FORD (tools/setup.sh docs).
"""

import html.parser
import re
import shutil
import subprocess
import sys
import urllib.parse
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "build" / "docs-pages"
OUTPUT = ROOT / "build" / "docs"
FORD = ROOT / ".venv" / "bin" / "ford"
# In the order of the contents.
ORDER = ["installation.md", "results.md", "scene.md", "scene_reference.md", "theory.md", "output.md", "statuses.md", "linking.md", "precision.md", "stability.md", "performance.md"]

failures = 0


def check(name, problems):
    global failures
    failures += bool(problems)
    print("not ok" if problems else "ok", name)
    for problem in problems[:40]:
        print(f"    {problem}")


# --- the comments -----------------------------------------------------------------------------------------------------


def public_names(text):
    """What a module offers that it defines itself."""
    listed = re.findall(r"^    public\s*::\s*((?:.*&\s*\n)*.*)$", text, re.M)
    return {name for block in listed for name in re.findall(r"[a-z_]\w*", re.sub(r"!.*", "", block), re.I)}


def undocumented(source):
    """Public entities of a source without a comment before them, and arguments of public procedures likewise."""
    lines = source.read_text().splitlines()
    text = "\n".join(lines)
    names = public_names(text)
    found = []
    for number, line in enumerate(lines):
        match = (
            re.match(r"\s*(?!end )(?:[\w() =,*:]*\s)?(?:subroutine|function)\s+(\w+)\s*\(", line, re.I)
            or re.match(r"\s*(?:abstract )?interface (\w+)$", line, re.I)
            or re.match(r"\s*type(?:\s*,[\w ,()]*)?\s*::\s*(\w+)$", line, re.I)
            or re.match(r"\s*(?:integer|real|character|logical|type)\b[^!]*parameter\b[^!]*::\s*(\w+)", line, re.I)
        )
        if not match or match[1] not in names or re.match(r"\s*(?:module )?procedure", line):
            continue
        names.discard(match[1])
        if not has_comment(lines, number):
            found.append(f"{source.relative_to(ROOT)}:{number + 1}: {match[1]}")
    return found


def has_comment(lines, number):
    """A comment stands directly above, or above the group of declarations that this one belongs to; that of a module's only
    type may be the module's."""
    while number > 0:
        above = lines[number - 1].strip()
        if above.startswith("!>"):
            return True
        if not above or above in ("contains",):
            break
        if not re.match(r"(integer|real|character|logical|type)\b|.*&$|.*\]$", above):
            return False
        number -= 1
    first = next((line for line in lines if line.startswith("!>")), None)
    is_type = re.match(r"\s*type\b", lines[number])
    return bool(first and is_type and sum(bool(re.match(r"    type\b[^(]*::", line)) for line in lines) == 1)


# --- the pages --------------------------------------------------------------------------------------------------------


def page(file):
    """A page of doc/ as FORD wants it: a title on top, links to the other pages as HTML, mathematics for MathJax."""
    text = file.read_text()
    title = re.match(r"# (.*)\n", text)[1]
    text = text.split("\n", 1)[1]
    parts = re.split(r"(^```.*?^```$)", text, flags=re.M | re.S)
    for i, part in enumerate(parts):
        if part.startswith("```math"):
            parts[i] = "$$" + part[len("```math") : -3] + "$$"
        elif not part.startswith("```"):
            part = re.sub(r"\]\((\w+)\.md(#[^)]*)?\)", lambda m: f"]({m[1]}.html{m[2] or ''})", part)
            part = re.sub(r"\[([^\]]*)\]\(\.\./([^)]*)\)", r"\1 (`\2`)", part)
            part = re.sub(r"\(`[^`]*`\)(?=`)", "", part)
            parts[i] = re.sub(r"(?<![\\$`])\$([^$`\n]+(?:\n[^$`\n]+)?)\$(?!\$)", r"\\(\1\\)", part)
    return f"title: {title}\n\n" + "".join(parts)


def make_pages():
    shutil.rmtree(PAGES, ignore_errors=True)
    PAGES.mkdir(parents=True)
    names = [name for name in ORDER if (ROOT / "doc" / name).exists()]
    for name in names:
        (PAGES / name).write_text(page(ROOT / "doc" / name))
    titles = {name: (PAGES / name).read_text().split("\n")[0][len("title: ") :] for name in names}
    listed = "".join(f"- [{title}]({name.replace('.md', '.html')})\n" for name, title in titles.items())
    order = "".join(f"ordered_subpage: {name}\n" for name in names)
    (PAGES / "index.md").write_text(f"title: Pages\n{order}\n{listed}")


# --- the links --------------------------------------------------------------------------------------------------------


class Links(html.parser.HTMLParser):
    """The links of a page, and the places that links can lead to."""

    def __init__(self, file):
        super().__init__()
        self.targets, self.places = [], {""}
        self.feed(file.read_text(errors="replace"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.places.update(values[key] for key in ("id", "name") if values.get(key))
        if tag == "a" and values.get("href"):
            self.targets.append(values["href"])


def dead_links():
    found = {file.resolve(): Links(file) for file in OUTPUT.rglob("*.html")}
    dead = set()
    for file, links in found.items():
        if "page" not in file.relative_to(OUTPUT).parts and file.name != "index.html":
            continue
        for target in links.targets:
            address = urllib.parse.urlsplit(target)
            if address.scheme or target in ("#", ""):
                continue
            there = (file.parent / urllib.parse.unquote(address.path)).resolve() if address.path else file
            if not there.exists() or (there in found and urllib.parse.unquote(address.fragment) not in found[there].places):
                dead.add(f"{file.relative_to(OUTPUT)}: {target}")
    return sorted(dead)


def main():
    sources = sorted((ROOT / "src").rglob("*.f90"))
    check("public-entities-have-comments", [problem for source in sources for problem in undocumented(source)])
    make_pages()
    shutil.rmtree(OUTPUT, ignore_errors=True)
    run = subprocess.run(
        [FORD, str(ROOT / "doc" / "reference.md")], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    # FORD would take a folder of figures for pages.
    shutil.copytree(ROOT / "doc" / "figures", OUTPUT / "page" / "figures")
    # Its progress names the files, error.f90 among them.
    told = [line for line in run.stdout.splitlines() if re.search(r"warning|error(?!\.f90)", line, re.I)]
    check("ford-has-nothing-to-warn-of", told + [f"exit code {run.returncode}"] * bool(run.returncode))
    wanted = ["index.html", "module/tandem.html", "type/model_type.html", "proc/tdintg.html", "page/linking.html"]
    check("reference-is-complete", [f"no {name}" for name in wanted if not (OUTPUT / name).exists()])
    check("links-lead-somewhere", dead_links())
    print(f"the reference: {(OUTPUT / 'index.html').relative_to(ROOT)}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
