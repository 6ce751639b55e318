"""Declarative validation of user input in files and requests: base model, error, text format.

A model is a subclass of :class:`Model`. A number with a range is ``Annotated[float, RANGE]``,
RANGE a :class:`fsw_control.schema.ranges.Range` with the unit; a docstring below a field describes
it.
The same definition gives the check, the error texts, the JSON Schema and the reference pages.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from itertools import islice, pairwise
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError, core_schema

from fsw_control.schema.errors import InputError as InputError
from fsw_control.schema.errors import Problem as Problem
from fsw_control.schema.files import read_regular
from fsw_control.schema.ranges import Range
from fsw_control.schema.yaml_text import content_of as content_of
from fsw_control.schema.yaml_text import json_content_of as json_content_of

_MOST_PROBLEMS = 10
#: number of errors for which similar names are searched; a large file of another kind has tens of
#: thousands
_MOST_COMPARED = 200
_NAME = "^[A-Za-z0-9_]+$"
#: what a value must be, in the words of YAML, by pydantic's type of error; its own words otherwise
_KINDS = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a mapping"),
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
}

T = TypeVar("T")
#: a list in a file
Many = Annotated[tuple[T, ...], Strict(False)]
#: a whole number, also written as 1e6
Whole = Annotated[int, BeforeValidator(lambda value: int(value) if _is_whole(value) else value)]
#: a word without spaces
Name = Annotated[str, Field(pattern=_NAME)]


def _is_whole(value: Any) -> bool:
    return isinstance(value, float) and value.is_integer()


class Model(BaseModel):
    """Base of all models: immutable, no unknown keys; numbers are finite, never booleans or text.

    A key without a value counts as absent.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, content: Any, info: ValidationInfo) -> Any:
        """Note the model of a mapping, so that errors about a key can list the known ones."""
        if info.context is not None:
            info.context[id(content)] = cls
        if isinstance(content, dict):
            return {key: value for key, value in content.items() if value is not None}
        return content

    def changed(self, **values: Any) -> Self:
        """Return a copy with some fields changed, validated; errors as in :func:`validate`."""
        # the fields only: a cached property is kept beside them
        present = {name: getattr(self, name) for name in type(self).model_fields}
        return validate(type(self), present | values, type(self).__name__)


class Parameters(Model):
    """Parameters with defaults; a file gives those that differ.

    ``what`` names them in errors; ``example`` is an example of a file's content.
    """

    what: ClassVar[str]
    example: ClassVar[str]

    @classmethod
    def from_yaml(cls, text: str, where: str = "") -> Self:
        """Read the parameters that differ from the defaults.

        Parameters
        ----------
        text : str
            YAML mapping of names to values.
        where : str
            Name of the source, for errors.

        Raises
        ------
        InputError
            If the text is empty or not a mapping, or a name or value is invalid.
        """
        where = where or cls.what
        content = content_of(text, where)
        if content is None:
            raise InputError(f"{where}: holds no parameters; give some, e.g. {cls.example}")
        return validate(cls, content, where)

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a YAML file, see :meth:`from_yaml`; an unreadable one is an InputError, too."""
        return cls.from_yaml(read_text(path, cls.what), str(path))


M = TypeVar("M", bound=Model)


def problem(text: str, *path: str | int) -> ValidationError:
    """Error for a validator to raise about a nested value at ``path``."""
    # braces would be parsed as names of a template
    error = PydanticCustomError("problem", "{text}", {"text": text})
    return ValidationError.from_exception_data(
        "", [InitErrorDetails(type=error, loc=path, input=None)]
    )


def needs_one(entry: M, *keys: str) -> M:
    """Return the entry if at least one of the keys is given; for validators."""
    if all(getattr(entry, key) is None for key in keys):
        raise ValueError(f"needs {', '.join(keys[:-1])} or {keys[-1]}")
    return entry


def validate(model: type[M], content: Any, where: str) -> M:
    """Validate the content of a file or request as a model; ``where`` names it in the message.

    Raises
    ------
    InputError
        If it is invalid; the message lists all problems with their places.
    """
    return validated_by(model.model_validate, content, where)


def validated_by(check: Callable[..., T], content: Any, where: str) -> T:
    """Validate by a function of pydantic, with content and context; errors as in `validate`."""
    models: dict[int, type[Model]] = {}
    try:
        return check(content, context=models)
    except ValidationError as error:
        first = islice(error.errors(include_url=False), _MOST_COMPARED)
        found_problems = dict.fromkeys(_problem(item, content, models) for item in first)
        problems, texts = tuple(one.problem for one in found_problems), list(found_problems)
        if len(texts) > _MOST_PROBLEMS:
            more = len(texts) - _MOST_PROBLEMS + max(0, error.error_count() - _MOST_COMPARED)
            texts[_MOST_PROBLEMS:] = [_Found(Problem("", ""), f"and {more} more")]
        listed = "; ".join(_known_once(texts))
        raise InputError(f"{where}: {listed}", problems=problems) from None


def shipped_names(folder: Path) -> list[str]:
    """Names of the YAML files in a folder."""
    return sorted(path.stem for path in folder.glob("*.yaml"))


def read_text(source: str | Path, what: str, shipped: Path | None = None) -> str:
    """Return the text of a file, or of a file in the folder ``shipped`` by its name.

    Raises
    ------
    InputError
        If it cannot be read; ``what`` is its expected content.
    """
    names = shipped_names(shipped) if shipped else []
    file = Path(source)
    try:
        if shipped and str(source) in names and not file.is_file():
            file = shipped / f"{source}.yaml"
        return read_regular(file).decode().replace("\r\n", "\n")
    except OSError as error:
        near = get_close_matches(str(source), names, 1)
        known = f"; give a YAML file or one of {', '.join(names)}" if names else ""
        known = f"; did you mean {near[0]}?" if near else known
        raise InputError(f"cannot read {what} {source}: {error.strerror}{known}") from None
    except ValueError:  # also a path with a null byte
        raise InputError(f"cannot read {what} {str(source)!r}: not a text file in UTF-8") from None


@cache
def descriptions(model: type[BaseModel]) -> dict[str, str]:
    """Descriptions of a model's fields: their docstrings, else the field's own description.

    They are read on demand: pydantic's ``use_attribute_docstrings`` reads the source of every
    model at import, which took up to a fifth of a node's start-up time.
    """
    texts = {
        name: field.description for name, field in model.model_fields.items() if field.description
    }
    for base in reversed(model.__mro__):
        if not issubclass(base, Model) or base is Model:
            continue
        # a generic model with its types has no source of its own, only its base has
        if base.__pydantic_generic_metadata__["origin"]:
            continue
        try:
            (definition,) = ast.parse(dedent(inspect.getsource(base))).body
        except OSError:  # made from a table by `create_model`
            continue
        assert isinstance(definition, ast.ClassDef)
        for field, text in pairwise(definition.body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=str(words))
                ):
                    texts[name] = inspect.cleandoc(words)
    return texts


def json_schema(model: type[Model]) -> dict[str, Any]:
    """JSON Schema of a model, for editors."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return head | model.model_json_schema(schema_generator=_GenerateJsonSchema)


def range_of(model: type[Model], field: str) -> Range:
    """Range of a number in a model."""
    info = model.model_fields[field]
    # of an optional one
    inside = (item for kind in get_args(info.annotation) for item in get_args(kind)[1:])
    return next(item for item in (*info.metadata, *inside) if isinstance(item, Range))


def without_default(schema: dict[str, Any]) -> None:
    """For ``Field(json_schema_extra=...)``: mark a default that stands for absence."""
    del schema["default"]


class _GenerateJsonSchema(GenerateJsonSchema):
    """JSON Schema in which optional is not nullable, and keys do not repeat as titles."""

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        document = super().model_schema(schema)
        model: type[BaseModel] = schema["cls"]
        for name, text in descriptions(model).items():
            document["properties"][model.model_fields[name].alias or name]["description"] = text
        return document

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        document = super().default_schema(schema)
        if document.get("default") in (None, []):
            document.pop("default", None)
        return document

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


class _Found(NamedTuple):
    """A problem in words; of an unknown key also those that are known, and the nearest of them."""

    problem: Problem
    text: str
    known: str = ""
    near: str = ""


def _known_once(problems: Iterable[_Found]) -> Iterator[str]:
    """The problems in words, each list of known keys only where it occurs first."""
    listed_before = {""}
    for _, text, known, near in problems:
        hint = f"; did you mean {near}?" if near else ""
        listed = "" if known in listed_before else f"{' ' if hint else '; '}known: {known}"
        yield text + hint + listed
        listed_before.add(known)


def _problem(error: ErrorDetails, content: Any, models: Mapping[int, type[Model]]) -> _Found:
    """One problem with its place."""
    path, inside, parent = "", content, content
    for step in error["loc"][: -1 if error["type"] == "missing" else None]:
        parent = inside
        if isinstance(inside, dict) and step in inside:
            path, inside = f"{path}.{step}" if path else str(step), inside[step]
        elif isinstance(inside, list) and isinstance(step, int):
            path, inside = f"{path}[{step}]", inside[step]
        # any other step is the tag of a union
    text = " ".join(f"{path} {_text(error)}".split())
    place = f"{path}.{error['loc'][-1]}".lstrip(".") if error["type"] == "missing" else path
    problem = Problem(place, error["type"])
    model = models.get(id(parent))
    if error["type"] not in _UNKNOWN_KEY or model is None:
        return _Found(problem, text)
    known = [field.alias or name for name, field in model.model_fields.items()]
    near = get_close_matches(str(error["loc"][-1]), known, 1)
    return _Found(problem, text, ", ".join(known), near[0] if near else "")


#: error types of a key that a model does not have
_UNKNOWN_KEY = ("extra_forbidden", "invalid_key")


def _text(error: ErrorDetails) -> str:
    kind, text = error["type"], error["msg"].replace("Input should be", "must be")
    if kind == "missing":
        return f"lacks {error['loc'][-1]}"
    if kind == "union_tag_not_found":
        return f"lacks {error['ctx']['discriminator']}"
    if kind in _UNKNOWN_KEY:
        return "is an unknown key"
    if kind == "value_error":
        return str(error["ctx"]["error"])
    if kind in ("problem", "outside", "not_a_number"):
        return text
    if kind == "string_pattern_mismatch" and error["ctx"]["pattern"] == _NAME:
        text = "must be a name (letters, digits, _)"
    if lacks := error.get("ctx", {}).get("lacks"):  # what a protocol asks for
        text += f" (it lacks {lacks})"
    return f"is {error['input']!r:.60}: {f'must be {_KINDS[kind]}' if kind in _KINDS else text}"
