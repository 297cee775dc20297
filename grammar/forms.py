"""Where a syntax error stands, in words: the block around it, the statement that was begun, and the form this has.

In: a `Situation`. Out: phrases for messages. The examples in `FORMS` are parsed by the tests, so that what is shown is right.
"""

from __future__ import annotations

from lark import Token

from hierc.grammar import errors, words
from hierc.grammar.problems import Edit, Problem
from hierc.grammar.situation import Repair, Situation, span_of

#: What opens a block, with where a statement in it stands.
BLOCKS = {
    "AGENT": "directly in an agent",
    "LEVEL": "directly in a level",
    "MODE": "directly in a mode",
    "DIFF": "under `diff`",
    "ALGE": "under `alge`",
    "INV": "under `inv`",
    "FOR": "in a `for` block",
    "DO": "in a `do` block",
    "SAMPLE": "in a `sample` block",
    "EXPERIMENT": "in an experiment",
    "GROUP": "in a `group` block",
    "INIT": "in an `init` block",
    "FILE": "at the top of a file",
}

#: The form of a statement by its first word, with what it is called.
FORMS = {
    "IMPORT": ("an import", "import vehicles.cars as cars;"),
    "FROM": ("an import", "from vehicles.cars import Car;"),
    "CONST": ("a constant", "const real g [m/s^2] = 9.81;"),
    "FUNC": ("a function", "func real area(real r) = pi*r^2;"),
    "EXTERN": ("an external function", 'extern real drag(real v [m/s]) [N] = "my_models:drag";'),
    "TABLE": ("a table", 'table thrust(real v [m/s]) [N] = "thrust.csv", linear;'),
    "EXPERIMENT": ("an experiment", "experiment fast of Cart(m = 5 [kg]) { stop = 10 [s]; }"),
    "ACCESS": ("a declaration", "write real x [m] = 0;"),
    "LET": ("a definition", "let e = r - x;"),
    "DIFF": ("a block of differential equations", "diff { x' = v; }"),
    "ALGE": ("a block of algebraic equations", "alge { F = k*x; }"),
    "INV": ("a block of conditions", 'inv { x > 0 : "too low"; }'),
    "FOR": ("a loop", "for i in 1..3 { x[i]' = v[i]; }"),
    "MODE": ("a mode", "mode sliding { diff { x' = v; } }"),
    "TRANS": ("a transition", "trans from falling to resting when x <= 0 do { v := 0; }"),
    "SAMPLE": ("a sampled block", "sample every 10 [ms] { u := k*e; }"),
    "LEVEL": ("a level", "level fast { agent motor = Motor(); }"),
    "GROUP": ("a group", "group wheels = left, right;"),
    "RECORD": ("a list of what is recorded", "record cart.x, cart.v;"),
    "SAVE": ("a list of files", 'save "out.csv";'),
}
AGENT_FORM = ("an agent", "agent Cart(real m [kg] = 10) { write real x = 0; }")
INSTANCE_FORM = ("an agent in an agent", "agent cart = Cart(m = 5 [kg]) [u := plan.x];")
GROUP_SETTINGS_FORM = ("a block of settings", "group cart { rtol = 1e-8; }")
INITIAL_FORM = ("a block of initial values", "init { cart.x = 1 [m]; }")
IF_FORM = "if x > 0 then x else 0"

_BEFORE_NAMES = ("SCALAR", "RSQB", "COMMA")

#: What a name is that is wanted after the terminal on the right, in the statement on the left.
_NAMES = {
    ("AGENT", "AGENT"): "a name for the agent",
    ("AGENT", "_EQUAL"): "the name of an agent",
    ("EXPERIMENT", "EXPERIMENT"): "a name for the experiment",
    ("EXPERIMENT", "OF"): "the name of an agent",
    ("LEVEL", "LEVEL"): "a name for the level",
    ("MODE", "MODE"): "a name for the mode",
    ("INIT", "MODE"): "a name for the mode",
    ("GROUP", "GROUP"): "a name for the group",
    ("GROUP", "_EQUAL"): "the name of an agent",
    ("GROUP", "COMMA"): "the name of an agent",
    ("GROUP", "EACH"): "the name of an array of agents",
    ("LET", "LET"): "a name for the value",
    ("TABLE", "TABLE"): "a name for the table",
    ("TABLE", "COMMA"): "`linear`, `cubic` or `hold`",
    ("FOR", "FOR"): "a name for the index",
    ("TRANS", "FROM"): "the name of a mode",
    ("TRANS", "TO"): "the name of a mode",
    ("TRANS", "HISTORY"): "the name of a mode",
    ("RECORD", "RECORD"): "a variable or an agent",
    ("RECORD", "COMMA"): "a variable or an agent",
    ("IMPORT", "IMPORT"): "the name of a file",
    ("IMPORT", "AS"): "another name for it",
    ("FROM", "FROM"): "the name of a file",
    ("FROM", "IMPORT"): "the name of a definition",
    ("FROM", "COMMA"): "the name of a definition",
    **{("ACCESS", before): "a name for the variable" for before in _BEFORE_NAMES},
    **{("CONST", before): "a name for the constant" for before in _BEFORE_NAMES},
    **{("FUNC", before): "a name for the function" for before in _BEFORE_NAMES},
    **{("EXTERN", before): "a name for the function" for before in _BEFORE_NAMES},
}

#: What stands in the blocks that hold one kind of statement.
_CONTENTS = {
    "DO": "an assignment or `}`",
    "SAMPLE": "an assignment or `}`",
    "FOR": "an equation or `}`",
    "GROUP": "a setting or `}`",
    "INIT": "an initial value or `}`",
    "INV": "a condition or `}`",
}


def block(at: Situation) -> str:
    """The terminal that opens the innermost block; `FILE` outside of all blocks."""
    depth = 0
    for token in reversed(at.pending):
        if token.type == "RBRACE":
            depth += 1
        elif token.type == "LBRACE":
            depth -= 1
        elif depth < 0 and token.type in BLOCKS:
            return token.type
    return "FILE"


def here(at: Situation) -> str:
    """Where a statement at the error would stand: `directly in an agent`."""
    return BLOCKS[block(at)]


def statement(at: Situation) -> str:
    """The terminal that the unfinished statement begins with; empty for one without a word of its own, and where one may begin."""
    known = (token.type for token in begun(at) if token.type in FORMS or token.type in ("AGENT", "INIT"))
    return next(known, "")


def begun(at: Situation) -> tuple[Token, ...]:
    """What the parser still holds of the unfinished statement."""
    if at.previous is None or at.previous.type in ("SEMICOLON", "LBRACE", "RBRACE"):
        return ()
    first = max((i for i, token in enumerate(at.pending) if token.type == "LBRACE"), default=-1) + 1
    return at.pending[first:]


def expected(at: Situation) -> str:
    """What may stand at the error, in words."""
    one_kind = {"NAME", "RBRACE"} <= at.accepts and not words.begins_statement(at.accepts)
    if one_kind and (phrase := _CONTENTS.get(block(at))):
        return phrase
    return words.expected(at.accepts, _name(at))


def _name(at: Situation) -> str:
    """What kind of name could stand at the error."""
    before = "" if at.previous is None else at.previous.type
    kind = statement(at)
    brackets = [b for b in at.open_brackets if b.type != "LBRACE"]
    if before == "FOR":
        return "a name for the index"
    if brackets and before in ("LPAR", "COMMA") and brackets[-1].type == "LPAR":
        return "the name of a parameter"
    if brackets and brackets[-1].type == "LPAR":
        return "a name for the parameter" if before in ("SCALAR", "RSQB") else "a name"
    if brackets and before in ("LSQB", "COMMA"):
        coupled = kind == "EXPERIMENT" or any(token.type == "RPAR" for token in begun(at))
        return "the name of a read variable" if coupled else "a name for the index"
    if (kind, before, block(at)) == ("GROUP", "GROUP", "EXPERIMENT"):
        return "the name of a group"
    return _NAMES.get((kind, before), "a name")


def form(at: Situation) -> str:
    """The form of the statement that is not followed, as a note; empty where the next word says enough."""
    if at.accepts & {"THEN", "ELSE"}:
        return f"a choice has the form `{IF_FORM}`"
    kind = statement(at)
    if not kind or at.accepts & {"NUMBER", "ADD", "SEMICOLON"} or words.begins_statement(at.accepts):
        return ""
    before = "" if at.previous is None else at.previous.type
    if before == "DOT" or (before == "FOR" and kind != "FOR"):
        return ""  # in the middle of a path or an expression
    what, example = _form(kind, block(at))
    return f"{what} has the form `{example}`"


def _form(kind: str, around: str) -> tuple[str, str]:
    match kind, around:
        case "AGENT", "FILE":
            return AGENT_FORM
        case "AGENT", _:
            return INSTANCE_FORM
        case "GROUP", "EXPERIMENT":
            return GROUP_SETTINGS_FORM
        case "INIT", "EXPERIMENT":
            return INITIAL_FORM
        case "INIT", _:
            return "a first mode", f"init {FORMS['MODE'][1]}"
        case _:
            return FORMS[kind]


# ---- the general form of a message --------------------------------------------------------------


def general(
    at: Situation,
    advice: tuple[str, ...] = (),
    bracket: Token | None = None,
    wanted: str = "",
    edits: tuple[Edit, ...] = (),
) -> Problem:
    """`expected … after …, found …`, with the form of the statement where there is no better advice."""
    return errors.UnexpectedText(
        at.place,
        wanted or expected(at),
        "" if at.previous is None else str(at.previous),
        words.found(at.found.type, at.found),
        advice,
        None if bracket is None else span_of(at.source, bracket),
        edits,
        "" if advice else form(at),
    )


def on_to_the_brace(at: Situation, problem: Problem) -> Repair | None:
    """Where a block must begin and does so further along the line, what stands between is left out."""
    ahead = at.matched(r"[^\n{};]*(?=\{)")
    if ahead is None or not at.fits("LBRACE"):
        return None
    return Repair(problem, (), ahead.end(), sure=True)
