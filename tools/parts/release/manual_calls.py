# SPDX-License-Identifier: GPL-2.0-or-later
"""Manual pages for the calls of a public header, made from the header's comments."""
import dataclasses
import errno
import os
import re

from parts.release.manual_page import body, entry, page, prototype, references, summary, verbatim

SECTION = 3
COMMENT = re.compile(r"/\*.*?\*/\n?", re.DOTALL)
CALL = re.compile(r"^(?!typedef\b)\w[\w \t*]*?\b(\w+)\([^;{}]*\);", re.MULTILINE)
MACRO = re.compile(r"^#define (\w+)(\([^)]*\))", re.MULTILINE)
PRIVATE = re.compile(r"\w_\b[ (]")
CODE = re.compile(r"(?:-|errno |(?<=[A-Z]) or )(E[A-Z0-9]+)\b")
# An error with its meaning, in a list of a comment: the lines below it that are indented further continue it.
MEANING = re.compile(r"^ *(?:errors +.*\n +)?-(E[A-Z0-9]+) {2,}(\S.*(?:\n {8,}[^-\s].*)*)", re.MULTILINE)
# The errors of another call are errors of this one, too.
ERRORS_OF = re.compile(r"(?:[Ee]rrors|[Ff]ails|else) as (ddx\w+)\(\)|those of\s+(ddx\w+)\(\)|one of\s+(ddx\w+)\(\)")
RESULT = re.compile(r"\b[Rr]eturns\b|^(?:[01][,;:. ]|NULL |Otherwise |-E)")
NAMES_RESULT = re.compile(r'Number|Whether|One |The |[01] |NULL |"|CLOCK_')
NOISE = re.compile(r'^(?:#(?:ifn?def|endif|if|else|include|pragma) ?.*|#define \w+_H|extern "C" \{|\})$')


@dataclasses.dataclass
class Item:
    """A comment and its code; a comment that begins with `The same` belongs to the previous item as well."""
    comment: str
    code: str
    topic: str   # of this part of the header
    names: list[str] = dataclasses.field(default_factory=list)


def comment_text(comment: str) -> str:
    inner = comment.strip().removeprefix("/*").removesuffix("*/")
    lines = [re.sub(r"^ \* ?", "", line).rstrip() for line in inner.splitlines()]
    return "\n".join([lines[0].strip(), *lines[1:]]).strip("\n")


def is_private(name: str) -> bool:
    return name.endswith("_")


def named(code: str) -> list[str]:
    """The calls, and the macros that are used as calls."""
    return [name for name in [found[1] for pattern in (MACRO, CALL) for found in pattern.finditer(code)]
            if not is_private(name)]


def pieces(header: str) -> list[tuple[str, str]]:
    """Comments at the beginning of a line, each with the code up to the next such comment or empty line."""
    result: list[tuple[str, str]] = []
    rest = header
    while rest:
        found = COMMENT.match(rest)
        comment = found[0] if found else ""
        rest = rest[len(comment):]
        code, empty, _ = rest.partition("\n\n")
        if inner := re.search(r"^/\*", code, re.MULTILINE):
            code, empty = code[:inner.start()], ""
        rest = rest[len(code) + len(empty):].lstrip("\n")
        result.append((comment_text(comment) if comment else "", code))
    return result


def items(header: str) -> list[Item]:
    result: list[Item] = []
    topic = ""
    for comment, code in pieces(header):
        if heading := re.match(r"---- (.*?) ----\n*", comment, re.DOTALL):
            topic, comment = heading[1], comment[heading.end():]
        code = "\n".join(line for line in code.splitlines() if not NOISE.match(line))
        names = named(code)
        if names and comment.startswith("The same") and result and result[-1].names:
            last = result[-1]
            last.comment += f"\n\n{comment}"
            last.code += f"\n{code}"
            last.names += names
        elif comment or code.strip():
            result.append(Item(comment, code, topic, names))
    return result


def declarations(all_items: list[Item], code: str) -> str:
    """The types of these headers that a call uses."""
    wanted = {name for name in re.findall(r"(?:struct|enum) (ddx\w+)", code) if not is_private(name)}
    return "\n\n".join(item.code.strip() for item in all_items if not item.names
                       and wanted & set(re.findall(r"^(?:struct|enum) (\w+) \{", item.code, re.MULTILINE)))


def about(item: Item) -> tuple[str, str]:
    """An item's summary and text; a comment with little more than errors gets the topic of its part in front."""
    if item.topic and re.match(r"Errors:|-E|After each ", item.comment):
        return summary(item.topic.replace(": ", " - ")), f"{item.topic}.\n\n{item.comment}"
    return summary(item.comment), item.comment


def kinds(item: Item) -> set[str]:
    """The types that the calls of an item return."""
    return {found[0][:found.start(1) - found.start()].strip() for found in CALL.finditer(item.code)} - {"void"}


def can_fail(item: Item) -> bool:
    """Whether ddx.h's rule for errors fits: the calls return a number or a pointer, and no other result is named."""
    return any(kind == "int" or kind.endswith("*") for kind in kinds(item)) and not NAMES_RESULT.match(item.comment)


def result_of(item: Item) -> str:
    """The results of an item's calls: the sentences about them, or the first sentence where it names the result, else
    the rule of ddx.h for all calls."""
    if not kinds(item) or not item.comment:
        return ""
    without_list = re.sub(r":\n(?: {2,}\S.*\n)+", " (see ERRORS)\n", item.comment)
    sentences = re.split(r"(?<=[.]) (?=[A-Z0-9`\"-])", " ".join(without_list.split()))
    said = [one for one in sentences if RESULT.search(one)]
    if any("eturns" in one for one in said):
        return " ".join(said)
    if not can_fail(item):
        return " ".join(dict.fromkeys([sentences[0], *said]))
    if said and not said[0].startswith("-E"):
        return " ".join(said)
    return "0, or a negative error number (-errno)." if "int" in kinds(item) else "NULL if it fails; `errno` is set."


def errors_of(item: Item, by_name: dict[str, Item], seen: frozenset[str] = frozenset()) -> list[str]:
    """The errors that a comment names, itself or as those of another call."""
    codes = CODE.findall(item.comment)
    for names in ERRORS_OF.findall(item.comment):
        name: str = next(filter(None, names))
        if name in by_name and name not in seen:
            codes += errors_of(by_name[name], by_name, seen | {name})
    return list(dict.fromkeys(codes))


def meanings(all_items: list[Item]) -> dict[str, str]:
    """The meaning of each error, as the introductions of the headers have it."""
    return {code: " ".join(text.split()) for item in reversed(all_items) if not item.names
            for code, text in MEANING.findall(item.comment)}


def errors(item: Item, all_items: list[Item]) -> str:
    known = {**meanings(all_items), **{code: " ".join(text.split()) for code, text in MEANING.findall(item.comment)}}
    by_name = {name: one for one in all_items for name in one.names}
    minus = "-" if "int" in kinds(item) else ""
    found = "".join(entry(f"{minus}{code}", known.get(code, os.strerror(getattr(errno, code)).lower()))
                    for code in sorted(errors_of(item, by_name)))
    if not found and not can_fail(item):
        return ""
    return f"{found}.PP\nWhat each error means in any call:\n.BR ddx.h ({SECTION}).\n"


def see_also(item: Item, text: str, known: set[str], header: str) -> str:
    others = sorted({*re.findall(r"\b(ddx\w+)\(\)", text)} & known - {*item.names})
    return references([*others, header], SECTION)


def call_page(item: Item, header: str, all_items: list[Item], known: set[str], release: str) -> dict[str, str]:
    short, text = about(item)
    calls = [found[0] for found in CALL.finditer(item.code) if not is_private(found[1])]
    macros = [found[1] + found[2] for found in MACRO.finditer(item.code) if not is_private(found[1])]
    synopsis = prototype(f"#include <{header}>") + "".join(".PP\n" + prototype(call) for call in [*macros, *calls])
    if types := declarations(all_items, item.code):
        synopsis += verbatim(types)
    first = item.names[0]
    pages = {first: page(item.names, SECTION, short, [
        ("SYNOPSIS", synopsis), ("DESCRIPTION", body(text)), ("RETURN VALUE", body(result_of(item))),
        ("ERRORS", errors(item, all_items)), ("SEE ALSO", see_also(item, text, known, header))], release)}
    return pages | {name: f".so man{SECTION}/{first}.{SECTION}\n" for name in item.names[1:]}


def header_page(header: str, library: str, all_items: list[Item], release: str) -> str:
    """The header's introduction, a list of its calls, and its types and constants."""
    introduction = next(item.comment for item in all_items if item.comment and "SPDX" not in item.comment)
    short = re.sub(r"^\w+: ", "", introduction)
    others = [item for item in all_items
              if not item.names and item.code.strip() and (item.comment or not PRIVATE.search(item.code))]
    types = "".join(body(item.comment) + verbatim(item.code.strip()) for item in others)
    calls = "".join(entry(", ".join(f"{name}(3)" for name in item.names), about(item)[0])
                    for item in all_items if item.names)
    build = f"cc program.c $(pkg-config --cflags --libs {library})"
    return page([header], SECTION, summary(short), [
        ("SYNOPSIS", prototype(f"#include <{header}>") + verbatim(build)), ("DESCRIPTION", body(introduction)),
        ("CALLS", calls), ("TYPES AND CONSTANTS", types)], release)


def pages(headers: dict[str, str], library: str, release: str) -> dict[str, str]:
    """Pages by name, without the section's suffix. `headers`: texts by name."""
    found = {name: items(text) for name, text in headers.items()}
    everything = [item for listed in found.values() for item in listed]
    known = {name for item in everything for name in item.names}
    result: dict[str, str] = {}
    for header, listed in found.items():
        result[header] = header_page(header, library, listed, release)
        for item in listed:
            if item.names:
                result |= call_page(item, header, everything, known, release)
    return result
