"""The templates beside this file say what stands where; `<<x>>` is a value, `<%` begins a command.

C is full of the braces that templates usually have.
"""

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined


@cache
def _environment() -> Environment:
    return Environment(
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
        loader=PackageLoader(__package__, ""),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
        autoescape=False,
    )


def render(template: str, **context: object) -> str:
    """The text of a template with these values."""
    return _environment().get_template(template).render(context)
