"""What is around every page: head line, language, colors; and how a fault is told on one."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from fastapi import Request
from nicegui import ui

from storage.errors import ArchiveError, InputError, UnknownNameError
from viewer.holdings import Holdings
from viewer.pages.components import say, tag
from viewer.texts import choose_language, texts_of

logger = logging.getLogger(__name__)

TOLD = (UnknownNameError, ArchiveError, InputError, OSError, ValueError)
"""What a page tells in a sentence: everything else is a fault of the program."""

_HEAD = '<link rel="stylesheet" href="/look/viewer.css"><script src="/look/head.js"></script>'


@dataclass(frozen=True)
class Site:
    """What all pages share."""

    holdings: Holdings
    runs_url: str
    """Where Prefect's dashboard is."""
    run_address: Callable[[str], str] | None = None
    """Returns where the runs of a take are told there."""


@dataclass(frozen=True)
class Shell:
    """A page that was begun: its words, and where a fault is told."""

    texts: Mapping[str, str]
    notice: ui.element
    language: str

    def text(self, name: str, **values: object) -> str:
        """Return a text with its places filled."""
        found = self.texts[name]
        for key, value in values.items():
            found = found.replace("{" + key + "}", str(value))
        return found

    def tell(self, text: str) -> None:
        """Show a sentence on top of the page, or nothing."""
        say(self.notice, text)
        self.notice.classes(remove="empty") if text else self.notice.classes("empty")

    def tell_fault(self, error: BaseException) -> None:
        """Show what went wrong as a sentence."""
        self.tell(self.text("fault", why=self.fault_text(error)))

    def fault_text(self, error: BaseException) -> str:
        """Return what went wrong as a sentence; what is no user's doing is logged in full."""
        if not isinstance(error, TOLD):
            logger.exception("a fault of the viewer", exc_info=error)
            error = RuntimeError(f"a fault of the program ({type(error).__name__}: {error})")
        return " ".join(str(error).split())

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Tell what goes wrong inside on the page, and go on."""
        try:
            yield
        except Exception as error:
            self.tell_fault(error)


def begin_page(site: Site, request: Request, here: str) -> Shell:
    """Build what is around a page, and return what it is filled by.

    Parameters
    ----------
    here
        Which page: "search", "browse" or "body_model".
    """
    language = choose_language(
        request.query_params.get("lang"),
        request.cookies.get("language"),
        request.headers.get("accept-language", ""),
    )
    texts = texts_of(language)
    ui.page_title(f"{texts[here]} · {texts['site']}")
    ui.add_head_html(_HEAD)
    ui.query("html").props(f"lang={language}")
    with tag("header", classes="top"):
        tag("a", texts["site"], "site", href="/browse")
        with tag("nav"):
            for name, address in (("browse", "/browse"), ("search", "/"), ("body_model", "/body")):
                current = {"aria_current": "page"} if name == here else {}
                tag("a", texts[name], "", href=address, **current)
            tag("a", texts["runs"], "", href=site.runs_url, target="_blank", rel="noopener")
        tag("span", classes="grow")
        where = site.holdings.location
        tag("span", "/".join(where.rstrip("/").split("/")[-2:]), "where", title=where)
        other = "ja" if language == "en" else "en"
        link = tag("button", texts["other_language"], "plain", data_control="language")
        link.on("click", js_handler=f"() => setLanguage('{other}')")
        theme = tag(
            "button",
            "◐",
            "plain",
            title=texts["theme"],
            aria_label=texts["theme"],
            data_control="theme",
        )
        theme.on("click", js_handler="() => nextTheme()")
    notice = tag("div", classes="notice empty", role="alert")
    return Shell(texts, notice, language)
