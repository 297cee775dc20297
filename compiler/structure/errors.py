"""Problems with experiments, settings and values given from outside (E9xx)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.compiler.suggest import did_you_mean, did_you_mean_without, edits_of, listed, respelt
from hierc.grammar.problems import Edit, Problem


@dataclass(frozen=True)
class UnknownSetting(Problem):
    code = "E903"
    explanation = "The settings of an experiment: stop start rtol atol interval max_step min_step method."
    name: str
    candidates: tuple[str, ...]

    def title(self) -> str:
        return f"unknown setting `{self.name}`"

    def help(self) -> tuple[str, ...]:
        return did_you_mean(self.name, self.candidates) or (f"the settings are {listed(self.candidates)}",)

    def edits(self) -> tuple[Edit, ...]:
        return edits_of(self.span, self.name, self.candidates)


@dataclass(frozen=True)
class MatchesNothing(Problem):
    code = "E904"
    explanation = "`record` lists variables by path, such as `arm.q`, elements of them, `arm.q[2]`, or all of an agent's, `arm.*`."
    pattern: str
    candidates: tuple[str, ...]
    shorter: str | None = None  # what it is without the name of a level

    def title(self) -> str:
        return f"`record {self.pattern}` matches nothing"

    def help(self) -> tuple[str, ...]:
        if self.shorter is not None:
            return (did_you_mean_without(self.shorter),)
        return did_you_mean(self.pattern, self.candidates)

    def edits(self) -> tuple[Edit, ...]:
        if self.shorter is not None:
            return respelt(self.span, self.pattern, self.shorter)
        return edits_of(self.span, self.pattern, self.candidates)


@dataclass(frozen=True)
class UnknownExperiment(Problem):
    code = "E908"
    explanation = "The name given to `run` or `load` is that of an experiment of the file, or of an agent to run on its own."
    name: str
    candidates: tuple[str, ...]

    def title(self) -> str:
        return f"there is no experiment or agent `{self.name}`"

    def help(self) -> tuple[str, ...]:
        return did_you_mean(self.name, self.candidates) or (f"choose one of {listed(self.candidates)}",)


@dataclass(frozen=True)
class NoChoice(Problem):
    """Nothing says which agent is the model."""

    code = "E909"
    explanation = (
        "What runs is the experiment or agent that was named; or the only experiment; or, without experiments, the only agent that no "
        "other agent contains. Where none of these is there, say which."
    )
    experiments: tuple[str, ...]
    agents: tuple[str, ...]

    def title(self) -> str:
        if not self.agents:
            return "the file defines no agent, so there is nothing to run"
        if self.experiments:
            return f"the file has the experiments {listed(self.experiments)}: name one"
        return "which agent is the model?"

    def notes(self) -> tuple[str, ...]:
        return (f"agents that no other agent contains: {listed(self.agents)}",) if self.agents else ()

    def help(self) -> tuple[str, ...]:
        if self.experiments:
            return ("an agent can be named too, to run it without an experiment",)
        return ("name one of them, or write an experiment",) if self.agents else ()


@dataclass(frozen=True)
class UnknownPath(Problem):
    code = "E910"
    explanation = (
        "Paths in an experiment start in its agent: `cart.x` is variable `x` of sub-agent `cart`. Levels are no part of paths. `group` names a group, "
        "or an agent or level that is in one as a whole."
    )
    what: str  # `state`, `group`, `agent`
    path: str
    candidates: tuple[str, ...]
    shorter: str | None = None  # what the path is without the name of a level
    several: tuple[str, ...] = ()  # the groups inside

    def title(self) -> str:
        return f"there is no {self.what} `{self.path}`"

    def help(self) -> tuple[str, ...]:
        if self.several:
            return (f"name one of the groups in `{self.path}`: {listed(self.several)}",)
        if self.shorter is not None:
            return (did_you_mean_without(self.shorter),)
        return did_you_mean(self.path, self.candidates)

    def edits(self) -> tuple[Edit, ...]:
        if self.several or self.shorter is not None:
            return ()
        return edits_of(self.span, self.path, self.candidates)


@dataclass(frozen=True)
class WrongValue(Problem):
    """A value from outside that does not fit a parameter, or a setting."""

    code = "E911"
    explanation = (
        "A value given to a parameter has its type and shape; a setting is a finite number, positive but for `start` and `stop`, `method` a name. A "
        "run ends after its start."
    )
    name: str
    wanted: str
    given: str

    def title(self) -> str:
        return f"`{self.name}` takes {self.wanted}, got {self.given}"


@dataclass(frozen=True)
class CannotSave(Problem):
    code = "E912"
    explanation = (
        "`save` names files by their ending: `.csv` is a table, `.npz` holds NumPy arrays. A model may come from a stranger, so it writes only "
        "inside the folder it is run in; elsewhere writes `hierc run -o`."
    )
    file: str
    endings: tuple[str, ...]
    outside: bool

    def title(self) -> str:
        if self.outside:
            return f"`{self.file}` is outside the folder of the run"
        return f"`{self.file}` does not end in {' or '.join(f'`{ending}`' for ending in self.endings)}"

    def help(self) -> tuple[str, ...]:
        if self.outside:
            return ("save to a name inside it; `hierc run … -o FILE` writes anywhere",)
        return ()
