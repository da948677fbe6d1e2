# SPDX-License-Identifier: GPL-2.0-or-later
"""Convert a program's -help text to a manual page."""
import pathlib
import re

from parts.release.manual_page import entry, escaped, page, prototype, references, summary

SECTION = 1
ABOUT = re.compile(r'^(?:/\* |""")(\w+): ([^\n]+?)\.(?: \*/)?$', re.MULTILINE)
TITLES = {"Signals": "SIGNALS", "Counters": "COUNTERS", "Exit status": "EXIT STATUS"}


def abouts(package: pathlib.Path) -> dict[str, str]:
    """A line about each program: the comment at the top of its main file."""
    files = [*package.rglob("main.c"), *package.rglob("*.py")]
    return {found[1]: found[2] for file in files if (found := ABOUT.search(file.read_text()[:400]))}


def split_entry(line: str) -> tuple[str, str]:
    """Split a line into an option or command and its meaning."""
    if found := re.fullmatch(r"(\S+(?: \S+)*?)  +(\S.*)", line):
        return found[1], found[2]
    if found := re.fullmatch(r"(-\S+ \S*[|]\S*) (\S.*)", line):  # no room for two blanks
        return found[1], found[2]
    return line, ""


def list_of(lines: list[str]) -> str:
    result, entries = "", list[list[str]]()
    least = min(len(line) - len(line.lstrip()) for line in lines)
    for line in lines:
        if len(line) - len(line.lstrip()) == least:
            entries.append([*split_entry(line.strip())])
        else:
            entries[-1].append(line.strip())
    for term, *meaning in entries:
        result += entry(term, " ".join(filter(None, meaning)))
    return result


def paragraphs(lines: list[str]) -> list[tuple[str, str]]:
    """Text without indent as title and man(7) text; a line that begins with a word of TITLES begins a section."""
    result: list[tuple[str, list[str]]] = [("", [])]
    for line in lines:
        word, colon, rest = line.partition(": ")
        if colon and word in TITLES:
            result.append((TITLES[word], [rest]))
        else:
            result[-1][1].append(line)
    return [(title, f".PP\n{escaped(' '.join(text))}\n") for title, text in result if text]


def blocks(text: str) -> list[list[str]]:
    """Blocks of lines, separated by empty lines and by changes between text and lists."""
    result: list[list[str]] = [[]]
    for line in text.splitlines():
        if not line.strip() or result[-1] and line.startswith(" ") != result[-1][-1].startswith(" "):
            result.append([])
        if line.strip():
            result[-1].append(line)
    return [lines for lines in result if lines]


def synopsis(text: str) -> tuple[list[str], str]:
    """The usage lines, and the rest of the text."""
    lines = text.splitlines()
    end = next((i for i, line in enumerate(lines[1:], 1) if not line.startswith("  ")), len(lines))
    joined = "\n".join(lines[:end]).removeprefix("usage:")
    name = joined.split()[0]
    usages = re.split(rf"(?:^|\n) *{re.escape(name)}(?= )", joined)[1:]
    return [f"{name}{usage}" for usage in usages], "\n".join(lines[end:])


def heading(lines: list[str]) -> str:
    """The title, if the block is one line of few words with a colon; else empty."""
    words = re.sub(r" *\(.*\)", "", lines[0]).removesuffix(":").split()
    return " ".join(words).upper() if len(lines) == 1 and lines[0].endswith(":") and len(words) <= 3 else ""


def sections(name: str, text: str) -> list[tuple[str, str]]:
    result: list[tuple[str, str]] = []
    title, before = "DESCRIPTION", ""
    for lines in blocks(text):
        if lines[0].startswith(" "):
            if not before.endswith(":"):
                title = "OPTIONS" if lines[0].lstrip().startswith("-") else "COMMANDS"
            result.append((title, list_of(lines)))
        elif own := heading(lines):
            title = own
        else:
            title = "NOTES" if title not in ("DESCRIPTION", "NOTES") else title
            lines[0] = re.sub(rf"^{re.escape(name)}: (.)", lambda found: found[1].upper(), lines[0])
            result += [(own or title, paragraph) for own, paragraph in paragraphs(lines)]
        before = lines[-1]
    return result


def program_page(name: str, what: str, help_text: str, others: list[str], release: str) -> str:
    usages, rest = synopsis(help_text)
    parts = [("SYNOPSIS", ".PP\n".join(prototype(usage) for usage in usages)), *sections(name, rest)]
    see = references([other for other in others if other != name], SECTION)
    return page([name], SECTION, what or summary(rest), [*merged(parts), ("SEE ALSO", see)], release)


def merged(parts: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Each title once."""
    result: dict[str, str] = {}
    for title, text in parts:
        result[title] = result.get(title, "") + text
    return list(result.items())
