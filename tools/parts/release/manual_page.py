# SPDX-License-Identifier: GPL-2.0-or-later
"""Convert plain text to man(7): paragraphs, lists of terms with their meaning, and code."""
import re
import textwrap

WIDTH = 76
LIST_LINE = re.compile(r"( *)(\S+(?: \S+)*?)(  +)(\S.*)")
CODE_INDENT = 4  # blanks before code and formulas


def escaped(text: str) -> str:
    """Text that troff prints unchanged. Words in `backquotes` become bold."""
    text = text.replace("\\", "\\e")
    text = re.sub(r"-(?=\w)", r"\\-", text).replace("--", "\\-\\-").replace("'", "\\(aq").replace("^", "\\(ha")
    text = text.replace("~", "\\(ti").replace("\u00b5", "\\(mc")
    text = re.sub(r"`([^`\n]+)`", r"\\fB\1\\fR", text).replace("`", "\\(ga")
    return re.sub(r"^\.", r"\\&.", text, flags=re.MULTILINE)


def verbatim(text: str) -> str:
    return f".PP\n.nf\n.RS 4\n{escaped(text.replace('`', chr(0))).replace(chr(0), '`')}\n.RE\n.fi\n"


def prototype(text: str) -> str:
    """A declaration, in lines of a page's width; no line ends within an argument."""
    lines = [""]
    for word in re.split(r"(?<=,) |(?<=\]) (?=\[)", " ".join(text.split())):
        if len(lines[-1]) + len(word) < WIDTH:
            lines[-1] += f" {word}" if lines[-1] else word
        else:
            lines.append(f"    {word}")
    return ".nf\n" + "".join(f'.B "{escaped(line)}"\n' for line in lines).replace('\\(aq', "'") + ".fi\n"


def entry(term: str, meaning: str) -> str:
    return f".TP\n\\fB{escaped(term)}\\fR\n{escaped(meaning) if meaning else '.'}\n"


def indent_of(line: str) -> int:
    return len(line) - len(line.lstrip())


def listed(lines: list[str]) -> str:
    """Entries of equal indent, each with continuation lines, which may be a nested list."""
    result = ""
    while lines:
        found = LIST_LINE.fullmatch(lines[0])
        if not found:
            return result + verbatim(textwrap.dedent("\n".join(lines)))
        column = found.start(4)
        end = next((i for i, line in enumerate(lines[1:], 1) if indent_of(line) < column), len(lines))
        own = next((i for i, line in enumerate(lines[1:end], 1) if indent_of(line) > column), end)
        after = next((i for i, line in enumerate(lines[own:end], own) if indent_of(line) == column), end)
        meaning = " ".join([found[4], *(line.strip() for line in lines[1:own])])
        result += entry(found[2], meaning)
        if own < end:
            result += f".RS\n{listed(lines[own:after])}.RE\n"
        if after < end:
            result += f".IP\n{escaped(' '.join(line.strip() for line in lines[after:end]))}\n"
        lines = lines[end:]
    return result


def block(lines: list[str]) -> str:
    """Lines of one kind: a paragraph, a list, or code."""
    indent = indent_of(lines[0])
    if indent >= CODE_INDENT:
        return verbatim(textwrap.dedent("\n".join(lines)))
    return listed(lines) if indent else f".PP\n{escaped(' '.join(lines))}\n"


def body(text: str) -> str:
    """The text of a comment; a change of indentation begins another block."""
    result, lines = "", list[str]()
    for line in [*text.splitlines(), ""]:
        if lines and (not line.strip() or bool(indent_of(lines[0])) != bool(indent_of(line))):
            result += block(lines)
            lines = []
        if line.strip():
            lines.append(line.rstrip())
    return result


def summary(text: str) -> str:
    """The first sentence or a part of it, for `apropos`."""
    first = re.split(r"[.;:](?= |$)", " ".join(text.split()), maxsplit=1)[0].replace("`", "")
    while len(first) > WIDTH and ", " in first:
        first = first.rpartition(", ")[0]
    if first.count("(") > first.count(")"):
        first = first.rpartition(" (")[0]
    return first[0].lower() + first[1:] if first[1:2].islower() or first[1:2] == " " else first


def references(names: list[str], section: int) -> str:
    return ",\n".join(f".BR {name} ({section})" for name in names) + "\n"


def page(names: list[str], section: int, about: str, sections: list[tuple[str, str]], release: str) -> str:
    """A page; `sections`: title and man(7) text; empty ones are left out."""
    parts = "".join(f".SH {title}\n{text.removeprefix('.PP' + chr(10))}" for title, text in sections if text)
    return (f'.TH "{names[0]}" "{section}" "" "{release}" "DDXVIDEO"\n.ad l\n.nh\n'
            f".SH NAME\n{escaped(', '.join(names))} \\- {escaped(about)}\n{parts}")
