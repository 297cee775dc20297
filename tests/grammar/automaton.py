"""The states of the parser, each with the shortest text that leads to it: what the tests of syntax messages walk.

The tables come from the grammar, so that a new rule is walked without a word here, except that a new sign needs a sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from itertools import count

from lark import Lark
from lark.lexer import PatternStr
from lark.parsers.lalr_analysis import LALR_Analyzer, RulePtr, Shift

State = frozenset[RulePtr]
Terminals = tuple[str, ...]

#: A text for each terminal that is not one fixed word or sign.
SAMPLES = {
    "SCALAR": "real",
    "ACCESS": "write",
    "KIND": "discrete",
    "RATE": "every",
    "BOOL": "true",
    "CMP": "<",
    "ADD": "+",
    "MUL": "*",
    "_EQUAL": "=",
    "NUMBER": "1",
    "UNIT": "[m/s]",
    "STRING": '"s"',
    "NAME": "x",
}
_PREFERRED = {"NUMBER": 0.9, "BOOL": 1.2, "TIME": 1.3}


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a text: the shortest terminals that lead to it from the beginning, and the shortest on from there to an end."""

    before: Terminals
    after: Terminals


class Automaton:
    """The LALR automaton of a grammar."""

    def __init__(self, lark: Lark) -> None:
        analyzer = LALR_Analyzer(lark.parser.parser_conf, debug=True)
        analyzer.compute_lalr()
        self.table: Mapping[State, Mapping[str, tuple[object, State]]] = analyzer.parse_table.states
        (self.start,) = analyzer.parse_table.start_states.values()
        self.rules = lark.rules
        self.samples = _samples(lark)

    @cached_property
    def shortest(self) -> dict[str, Terminals]:
        """The shortest terminals of each nonterminal."""
        best: dict[str, Terminals] = {}
        changed = True
        while changed:
            changed = False
            for rule in self.rules:
                names = [symbol.name for symbol in rule.expansion]
                if any(name not in best and not _is_terminal(name) for name in names):
                    continue
                new = tuple(t for name in names for t in best.get(name, (name,)))
                old = best.get(rule.origin.name)
                if old is None or _cost(new) < _cost(old):
                    best[rule.origin.name] = new
                    changed = True
        return best

    def places(self) -> dict[State, Place]:
        """A place for each state that can be reached. Where states share one, they are told apart only by what follows."""
        return {stack[-1]: Place(before, self._completion(stack)) for stack, before in self._paths().items()}

    def _paths(self) -> dict[tuple[State, ...], Terminals]:
        """The cheapest way to each state (Dijkstra): the states passed and the terminals read."""
        found: dict[tuple[State, ...], Terminals] = {}
        seen: set[State] = set()
        order = count()
        heap = [(_cost(()), next(order), (self.start,), ())]
        while heap:
            _, _, stack, before = heappop(heap)
            if stack[-1] in seen:
                continue
            seen.add(stack[-1])
            found[stack] = before
            for name, (action, target) in self.table[stack[-1]].items():
                if action is Shift and target not in seen:
                    new = before + self.shortest.get(name, (name,))
                    heappush(heap, (_cost(new), next(order), (*stack, target), new))
        return found

    def _completion(self, stack: tuple[State, ...]) -> Terminals:
        """The cheapest terminals with which the parser, having passed these states, accepts the text."""
        order = count()
        heap: list[tuple[tuple[float, Terminals], int, tuple[State, ...], Terminals]] = []
        heappush(heap, (_cost(()), next(order), stack, ()))
        while True:
            _, _, states, after = heappop(heap)
            for item in states[-1]:
                root = item.rule.origin.name.startswith("$root")
                if not item.index and not root:
                    continue
                rest = (symbol.name for symbol in item.rule.expansion[item.index :])
                new = after + tuple(t for name in rest for t in self.shortest.get(name, (name,)))
                if root:
                    return tuple(t for t in new if t != "$END")
                below = states[: len(states) - item.index]
                target = self.table[below[-1]][item.rule.origin.name][1]
                heappush(heap, (_cost(new), next(order), (*below, target), new))

    def text(self, terminals: Terminals) -> str:
        """Terminals as a text, laid out as people do, for line breaks help to see what is missing."""
        text, depth = "", 0
        for terminal in terminals:
            depth -= terminal == "RBRACE"
            blank = " " if text and not text.endswith("\n") else "  " * max(depth, 0)
            text += blank + self.samples[terminal]
            depth += terminal == "LBRACE"
            text += "\n" if terminal in ("LBRACE", "RBRACE", "SEMICOLON") else ""
        return text


def _is_terminal(name: str) -> bool:
    return name.lstrip("_").isupper() or name == "$END"


def _cost(terminals: Terminals) -> tuple[float, Terminals]:
    """The number of terminals, the simplest expressions first. Unlike the automaton's own order, this does not change from run to run."""
    return sum(_PREFERRED.get(terminal, 1.0) for terminal in terminals), terminals


def _samples(lark: Lark) -> dict[str, str]:
    texts: dict[str, str] = {}
    for terminal in lark.terminals:
        plain = terminal.pattern.value.removesuffix(r"\b")
        fixed = isinstance(terminal.pattern, PatternStr) or plain.isalpha()
        texts[terminal.name] = SAMPLES.get(terminal.name, plain if fixed else "")
    return {name: text for name, text in texts.items() if text and name not in lark.ignore_tokens}
