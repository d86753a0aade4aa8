"""Equations as MathML, which browsers draw by themselves: no script, no network. Labels "paper-N" are numbered N."""

from __future__ import annotations

from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.domains.math import MathDomain

LABEL = "paper-"


class PaperMathDomain(MathDomain):  # type: ignore[misc]
    """Sphinx's equations, those of the paper under the paper's own numbers."""

    def get_equation_number_for(self, labelid: str) -> int | None:
        number = labelid.removeprefix(LABEL)
        return int(number) if number != labelid else super().get_equation_number_for(labelid)

    def resolve_xref(self, env: Any, fromdocname: str, builder: Any, typ: str, target: str, *rest: Any) -> Any:
        if not target.startswith(LABEL) or target not in self.equations:
            return super().resolve_xref(env, fromdocname, builder, typ, target, *rest)
        docname, _ = self.equations[target]
        text = f"({target.removeprefix(LABEL)})"
        address = f"{builder.get_relative_uri(fromdocname, docname)}#{nodes.make_id(f'equation-{target}')}"
        return nodes.reference("", text, internal=True, refuri=address)


def mathml(latex: str, display: str) -> str:
    """An equation for a page; primes become single characters, as two of them in a row would be set apart."""
    for primes, sign in (("''", "\u2033"), ("'", "\u2032")):
        latex = latex.replace(f"{primes}^2", f"^{{{sign} 2}}").replace(primes, f"^{{{sign}}}")
    done: str = convert(latex, display=display)
    return done


def inline(self: Any, node: nodes.math) -> None:
    self.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def displayed(self: Any, node: nodes.math_block) -> None:
    label = node.get("label") or ""
    number = label.removeprefix(LABEL) if label.startswith(LABEL) else node.get("number")
    place = f' id="{escape(nodes.make_id(f"equation-{label}"))}"' if label else ""
    shown = f'<span class="eqno">({number})</span>' if label else ""
    self.body.append(f'<div class="equation"{place}>{mathml(node.astext(), "block")}{shown}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_domain(PaperMathDomain, override=True)
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True}
