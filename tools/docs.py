#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the reference of the library, build/docs/index.html, from the comments of the sources and the pages of doc/.

Usage: tools/docs.py

Its front page begins like README.md. Scripts and styles are beside the pages, so that they can be read without a network.

Prints "ok NAME" or "not ok NAME" for each check: folders use each other one way, as CONTRIBUTING.md shows, every public entity
has a comment, FORD has nothing to warn of, every link between the pages leads somewhere, and no page fetches anything. The exit
code is 1 if anything failed. Needs FORD and the packages
with the scripts (tools/setup.sh docs).
"""

import html
import html.parser
import json
import re
import shutil
import subprocess
import sys
import urllib.parse
import zipfile
from pathlib import Path

import arrows
import python_api

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "build" / "docs-pages"
OUTPUT = ROOT / "build" / "docs"
FRONT = ROOT / "build" / "docs-front.md"
FORD = ROOT / ".venv" / "bin" / "ford"
SITE = ROOT / ".deps" / "site"
# Files that the pages load: the address in FORD's templates, the file beside the pages, its package and path.
ASSETS = [
    ("cdn.jsdelivr.net/npm/bootstrap[^\"]*css", "bootstrap.min.css", "mkdocs", "mkdocs/themes/mkdocs/css/bootstrap.min.css"),
    ("cdn.jsdelivr.net/npm/bootstrap[^\"]*js", "bootstrap.min.js", "mkdocs", "mkdocs/themes/mkdocs/js/bootstrap.bundle.min.js"),
    ("unpkg.com/lunr[^\"]*", "lunr.js", "mkdocs", "mkdocs/contrib/search/templates/search/lunr.js"),
    ("cdn.jsdelivr.net/npm/mathjax[^\"]*", "mathjax.js", "django_static_mathjax", "mathjax/static/mathjax/es5/tex-svg.js"),
]
STYLE = """
#text img { max-width: 100%; }
#text table:not(.table) { margin-bottom: 1rem; }
#text table:not(.table) :is(th, td) { padding: 0.2rem 0.8rem 0.2rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
"""
MATHJAX_LICENCE = "mathjax/static/mathjax/LICENSE"
# Modules whose procedures programs call without `use`.
INTERFACES = {"tandem_legacy_c", "tandem_legacy_f77"}
# In the order of the contents.
ORDER = ["installation.md", "results.md", "scene.md", "scene_reference.md", "mechanism.md", "mechanism_reference.md",
         "mechanism_gallery.md", "mechanism_advice.md", "sparse.md", "linearisation.md", "sweep.md", "python.md", "robots.md",
         "python_api.md", "expressions.md", "theory.md", "output.md", "options.md", "statuses.md", "linking.md", "precision.md", "stability.md", "performance.md"]

failures = 0


def check(name, problems):
    global failures
    failures += bool(problems)
    print("not ok" if problems else "ok", name)
    for problem in problems[:40]:
        print(f"    {problem}")


# --- the comments -----------------------------------------------------------------------------------------------------


def public_names(text):
    """Names that a module defines and makes public."""
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


def page(text):
    """A page of doc/ for FORD: a title on top, links to the other pages as HTML, mathematics for MathJax."""
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
    texts = {name: (ROOT / "doc" / name).read_text() for name in ORDER if (ROOT / "doc" / name).exists()} | {"python_api.md": python_api.page()}
    names = [name for name in ORDER if name in texts]
    for name in names:
        (PAGES / name).write_text(page(texts[name]))
    titles = {name: (PAGES / name).read_text().split("\n")[0][len("title: ") :] for name in names}
    listed = "".join(f"- [{title}]({name.replace('.md', '.html')})\n" for name, title in titles.items())
    order = "".join(f"ordered_subpage: {name}\n" for name in names)
    (PAGES / "index.md").write_text(f"title: Pages\n{order}\n{listed}")


def front_page():
    """Source of the front page for FORD: its settings, the start of README.md, and the text of doc/reference.md."""
    settings, text = (ROOT / "doc" / "reference.md").read_text().split("---\n", 2)[1:]
    start = (ROOT / "README.md").read_text().split("\n## Steppers", 1)[0].split("\n", 1)[1]
    start = start.replace("](doc/figures/", "](media/")
    start = re.sub(r"\]\(doc/(\w+)\.md(#[^)]*)?\)", lambda m: f"](page/{m[1]}.html{m[2] or ''})", start)
    # Examples and scenes are not pages.
    start = re.sub(r"\[((?:example|scenes)/[^\]]*)\]\([^)]*\)", r"`\1`", start)
    start = re.sub(r"(?<!\$)\$([^$`\n]+)\$(?!\$)", r"\\(\1\\)", start)
    FRONT.write_text(f"---\n{settings}---\n{start}\n{text}")


# --- post-processing of the output of FORD -------------------------------------------------------------------------------


def bring_motions():
    """Pages that play the motions, behind their pictures, if the package for Python is installed; else only pictures."""
    python = ROOT / "build" / "python" / "bin" / "python"
    if not python.exists():
        return
    code = "import sys, tandem; tandem.run_scene(sys.argv[1], {'output.interval': 0.02}, error=False).view(sys.argv[2])"
    for picture in sorted((ROOT / "doc" / "figures").glob("*_page.png")):
        scene = picture.stem.removesuffix("_page")
        target = OUTPUT / "page" / "figures" / f"{scene}.html"
        subprocess.run([python, "-c", code, scene, target], check=True, cwd=ROOT)
        for page in (OUTPUT / "page").glob("*.html"):
            text = page.read_text()
            if f'href="figures/{picture.name}"' in text:
                page.write_text(text.replace(f'href="figures/{picture.name}"', f'href="figures/{scene}.html"'))


def bring_assets():
    """Replace addresses of scripts and styles by local files; mathematics only on pages with formulas."""
    folder = OUTPUT / "assets"
    folder.mkdir()
    wheels = {file.name.split("-")[0]: zipfile.ZipFile(file) for file in SITE.glob("*.whl")}
    for _, name, package, place in ASSETS:
        text = wheels[package].read(place).decode()
        (folder / name).write_text(re.sub(r"\n(/\*|//)# sourceMappingURL=.*", "", text))
    (folder / "mathjax-licence.txt").write_bytes(wheels["django_static_mathjax"].read(MATHJAX_LICENCE))
    settings = "window.MathJax = {tex: {tags: 'ams'}, options: {enableMenu: false}};"
    for file in OUTPUT.rglob("*.html"):
        text = file.read_text()
        # python-markdown-math writes what MathJax 2 reads.
        text = re.sub(r'<script type="math/tex(; mode=display)?">(.*?)</script>', mathematics, text, flags=re.S)
        here = "../" * (len(file.relative_to(OUTPUT).parts) - 1) + "assets/"
        text = re.sub(r'<script type="text/x-mathjax-config">.*?</script>', f"<script>{settings}</script>", text, flags=re.S)
        if not re.search(r"\\\(|\\\[", text):
            text = re.sub(r"<script>window\.MathJax.*?</script>\s*|<script src=\"https://[^>]*mathjax[^>]*></script>\s*", "", text)
        for address, name, _, _ in ASSETS:
            text = re.sub(rf'(src|href)="https://{address}"([^>]*?)(?:\s+integrity="[^"]*")?(?:\s+crossorigin="[^"]*")?>',
                          rf'\1="{here}{name}"\2>', text)
        file.write_text(text)
    with open(OUTPUT / "css" / "local.css", "a") as style:
        style.write(STYLE)


def mathematics(match):
    """A formula for MathJax 3; entities of HTML are as they were, in display mode they are not."""
    text = html.escape(html.unescape(match[2]), quote=False).strip()
    return f"\\[{text}\\]" if match[1] else f"\\({text}\\)"


def offered():
    """(name, module) of the names that `use tandem` provides."""
    text = re.sub(r"&\s*\n\s*", "", (ROOT / "src" / "tandem.f90").read_text())
    return {(name, module) for module, names in re.findall(r"^    use (\w+), only: (.*)", text, re.M) for name in names.split(", ")}


def set_internals_apart():
    """Put the names for programs first in each list; mark the pages and search results of the others as internal."""
    known, public = offered(), set()
    for file in (OUTPUT / "lists").glob("*.html"):
        text = file.read_text()
        table = re.search(r"<table.*?</table>", text, re.S)
        head, body = table[0].split("<tbody>")
        head, rows = head + "<tbody>", re.findall(r"<tr.*?</tr>", body, re.S)
        for_programs = [row for row in rows if is_for_programs(row, known)]
        public |= {re.search(r"href='\.\./([^']*)'", row)[1] for row in for_programs}
        internal = [row for row in rows if row not in for_programs]
        parts = [("For programs", for_programs), ("Internals", internal)]
        new = "".join(f"<h2>{title}</h2>\n{head}\n{''.join(part)}</tbody></table>\n" for title, part in parts if part)
        file.write_text(text.replace(table[0], new))
    note = '<div class="alert alert-secondary">Internal: no program needs it, and it may change.</div>'
    for folder in ("module", "type", "proc", "interface"):
        for file in (OUTPUT / folder).glob("*.html"):
            if f"{folder}/{file.name}" not in public:
                place = r'(<div class="container">\s*\n)(?=\s*<div class="row">)'
                file.write_text(re.sub(place, rf"\1{note}\n", file.read_text(), count=1))
    front = OUTPUT / "index.html"
    links = [f"<li><a href='{target}'>" for target in public]
    front.write_text(re.sub(r"<li><a href='(?:module|type|proc|interface)/[^']*'>.*?</li>",
                            lambda m: m[0] if m[0].startswith(tuple(links)) else "", front.read_text()))
    developers = r'\s*<div class="col-md-4">\s*<div class="card card-body bg-light">\s*<h2[^>]*>Developer Info.*?</div>\s*</div>'
    text = re.sub(developers, "", front.read_text(), flags=re.S)
    front.write_text(text.replace("<div class=col-md-8>", '<div class="col-md-12">'))
    database = OUTPUT / "search" / "search_database.json"
    start, found = database.read_text().split("=", 1)
    found = json.loads(found)
    for entry in found["pages"]:
        if entry["url"].split("/")[0] in ("module", "type", "proc", "interface") and entry["url"] not in public:
            entry["title"] += " (internal)"
    database.write_text(f"{start}={json.dumps(found, separators=(',', ':'))}")
    script = OUTPUT / "search" / "load_search.js"
    rank = "(found) => documents[found.ref].title.endsWith(' (internal)')"
    sort = f"last = {rank};\n\tresults.sort((a, b) => last(a) - last(b));"
    script.write_text(script.read_text().replace("idx.search(term);", f"idx.search(term), {sort}"))
    return public


def is_for_programs(row, known):
    """A row of a list: the name, then for most the module or the file."""
    cells = [re.sub(r"<[^>]*>|&nbsp;", "", cell).strip() for cell in re.findall(r"<td>(.*?)</td>", row, re.S)]
    name, place = cells[0], cells[1]
    return name in INTERFACES | {"tandem"} or (name, place) in known or place in INTERFACES or place.endswith("f77.f90")


def fetched():
    """Resources that a page would load from elsewhere: scripts, styles, pictures, fonts."""
    found = set()
    for file in [*OUTPUT.rglob("*.html"), *OUTPUT.rglob("*.css")]:
        text = file.read_text(errors="replace")
        for pattern in (
            r"<(?:script|img|iframe)[^>]*src=[\"']?(?:https?:)?//[^\"'> ]*",
            r"<link[^>]*href=[\"']?(?:https?:)?//[^\"'> ]*",
            r"url\([\"']?(?:https?:)?//[^)]*",
            r"@import[^;]*//[^;]*",
        ):
            found.update(f"{file.relative_to(OUTPUT)}: {match}" for match in re.findall(pattern, text))
    return sorted(found)


def mathematics_problems():
    """Every page with a formula loads MathJax, and no formula is left as MathJax 2 reads it."""
    problems = []
    for file in OUTPUT.rglob("*.html"):
        text = file.read_text()
        if "math/tex" in text or ("\\(" in text and "assets/mathjax.js" not in text):
            problems.append(str(file.relative_to(OUTPUT)))
    return problems + ["no formula in page/theory.html"] * ("\\[" not in (OUTPUT / "page" / "theory.html").read_text())


def search_problems():
    """A search looks in a database beside the pages; a page must be in it, and the script that reads it."""
    text = (OUTPUT / "search.html").read_text()
    found = json.loads((OUTPUT / "search" / "search_database.json").read_text().split("=", 1)[1])["pages"]
    places = {entry["url"] for entry in found}
    problems = [f"no {wanted} in search.html" for wanted in ("assets/lunr.js", "search_database.json") if wanted not in text]
    problems += [f"{wanted} cannot be found" for wanted in ("page/theory.html", "type/model_type.html") if wanted not in places]
    if "results.sort" not in (OUTPUT / "search" / "load_search.js").read_text():
        problems.append("internals are not found last")
    return problems + [f"{place} does not exist" for place in places if not (OUTPUT / place).exists()]


# --- the links --------------------------------------------------------------------------------------------------------


class Links(html.parser.HTMLParser):
    """Links of a page, and its link targets."""

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
    check("folders-use-each-other-one-way", arrows.problems())
    sources = sorted((ROOT / "src").rglob("*.f90"))
    check("public-entities-have-comments", [problem for source in sources for problem in undocumented(source)])
    make_pages()
    front_page()
    shutil.rmtree(OUTPUT, ignore_errors=True)
    run = subprocess.run(
        [FORD, str(FRONT)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    # FORD would treat a folder of figures as pages.
    shutil.copytree(ROOT / "doc" / "figures", OUTPUT / "page" / "figures")
    bring_motions()
    # Its progress bars name files and entities, some of which are called `error`.
    told = [line for line in run.stdout.splitlines() if "\u2501" not in line and re.search(r"warning|error(?!\.f90)", line, re.I)]
    check("ford-has-nothing-to-warn-of", told + [f"exit code {run.returncode}"] * bool(run.returncode))
    wanted = ["index.html", "module/tandem.html", "type/model_type.html", "proc/tdintg.html", "page/linking.html"]
    check("reference-is-complete", [f"no {name}" for name in wanted if not (OUTPUT / name).exists()])
    bring_assets()
    public = set_internals_apart()
    check("links-lead-somewhere", dead_links())
    check("pages-fetch-nothing", fetched())
    check("mathematics-is-for-mathjax", mathematics_problems())
    check("search-finds-pages", search_problems())
    used = ["module/tandem.html", "type/model_type.html", "proc/verify_model.html", "proc/tdintg.html"]
    check("internals-are-apart", [f"{name} is no internal" for name in used if name not in public]
          + [f"{name} is an internal" for name in ("module/tandem_linalg_lapack.html", "type/basis_type.html") if name in public])
    print(f"the reference: {(OUTPUT / 'index.html').relative_to(ROOT)}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
