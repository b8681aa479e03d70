"""`serve`: a web page, the queue, and the interfaces that slicers use to send files."""

from __future__ import annotations

import argparse
import os
import signal
import webbrowser
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output_options, add_printers_file_option
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import print_result, print_text
from printer_slicer.errors import UsageError

if TYPE_CHECKING:
    from printer_slicer.print_queue import PrintQueue
    from printer_slicer.server.access import AccessStore, ApiKey

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer serve                            serve this computer at port 5000
  printer-slicer serve --demo                     try it with two simulated printers
  printer-slicer serve --new-key sofa --scopes all
  printer-slicer serve --listen 0.0.0.0 --host printbox.local"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `serve`."""
    parser.add_argument(
        "--listen",
        metavar="ADDRESS[:PORT]",
        default="127.0.0.1:5000",
        help="where to listen; default: %(default)s, which only this computer reaches",
    )
    parser.add_argument(
        "--host",
        metavar="NAME",
        action="append",
        default=[],
        help="another name of this computer in browsers",
    )
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument("--demo", action="store_true", help="show two simulated printers and a queue")
    keys = parser.add_argument_group("keys of slicers and people")
    keys.add_argument("--keys", action="store_true", help="list the keys")
    keys.add_argument("--new-key", metavar="NAME", help="create a key, which is shown once")
    keys.add_argument(
        "--scopes",
        metavar="LIST",
        default="read,upload,print",
        help="what the new key allows: read, upload, print, control, admin or all; default: %(default)s",
    )
    keys.add_argument(
        "--for", dest="printer", metavar="PRINTER", default="", help="the only printer of the new key"
    )
    keys.add_argument("--delete-key", metavar="ID", help="delete a key")
    for action in (
        parser.add_argument(
            "--origin",
            metavar="URL",
            action="append",
            default=[],
            help="address of another site whose pages may send requests with a key",
        ),
        parser.add_argument(
            "--proxy",
            metavar="ADDRESS",
            default="",
            help="address of the reverse proxy whose X-Forwarded headers are trusted",
        ),
    ):
        mark_advanced(action)
    add_printers_file_option(parser)
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Change the keys, or run the server until Ctrl-C."""
    try:
        import uvicorn  # noqa: F401
    except ImportError:
        raise UsageError(
            "serve needs packages that are not installed", remedy="Run pip install 'printer-slicer[serve]'"
        ) from None
    from printer_slicer.print_queue import open_queue
    from printer_slicer.server.access import AccessStore

    with ExitStack() as stack:
        if arguments.demo:
            from printer_slicer.server.demo import end_demo_prints, open_demo_folder, open_demo_queue

            _interrupt_on_signals()  # otherwise its prints would go on
            folder = stack.enter_context(open_demo_folder())
            os.environ["PRINTER_SLICER_STATE"] = str(folder)  # its prints are not to be resumed later
            queue = open_demo_queue(folder)
            stack.callback(queue.close)
            stack.callback(end_demo_prints, queue)
        else:
            queue = open_queue(printers_file=arguments.printers_file)
            stack.callback(queue.close)
        access = AccessStore(queue.folder / "access.db")
        stack.callback(access.close)
        return _run_action(arguments, queue, access)


def _interrupt_on_signals() -> None:
    """End the program as Ctrl-C does if it is terminated or its terminal is closed; `nohup` keeps its effect."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(*_: object) -> None:
    """End the program as Ctrl-C does."""
    raise KeyboardInterrupt


def _run_action(arguments: argparse.Namespace, queue: PrintQueue, access: AccessStore) -> int:
    """Change or list the keys if that is wanted; otherwise run the server."""
    if arguments.new_key is not None:
        return _create_key(arguments, queue, access)
    if arguments.delete_key:
        access.delete_key(arguments.delete_key)
        return print_result(
            arguments, {"deleted": arguments.delete_key}, f"deleted key {arguments.delete_key}"
        )
    if arguments.keys:
        keys = access.list_keys()
        text = "\n".join(map(_describe_key, keys)) or "there are no keys"
        return print_result(arguments, {"keys": [_list_key_facts(one) for one in keys]}, text)
    _serve(arguments, queue, access)
    return 0


def _create_key(arguments: argparse.Namespace, queue: PrintQueue, access: AccessStore) -> int:
    """Create a key, and print it."""
    from printer_slicer.server.access import SCOPES

    if arguments.printer:
        queue.find_printer(arguments.printer)  # fails if there is none
    names = [name.strip() for name in arguments.scopes.split(",")]
    scopes: Any = SCOPES if names == ["all"] else names
    key, text = access.create_key(arguments.new_key, scopes, arguments.printer)
    return print_result(arguments, _list_key_facts(key) | {"text": text}, f"{text}\n{_describe_key(key)}")


def _list_key_facts(key: ApiKey) -> dict[str, Any]:
    """Return a key for JSON."""
    return {
        "id": key.id,
        "name": key.name,
        "scopes": sorted(key.scopes),
        "printer": key.printer,
        "used": key.used,
    }


def _describe_key(key: ApiKey) -> str:
    """Return a line about a key."""
    where = f" on printer {key.printer}" if key.printer else ""
    return f"key {key.id} ({key.name}) allows {', '.join(sorted(key.scopes))}{where}"


def _serve(arguments: argparse.Namespace, queue: PrintQueue, access: AccessStore) -> None:
    """Run the server until Ctrl-C."""
    from printer_slicer.server.running import Listener, check_listener, parse_listener, run_server

    address, port = parse_listener(arguments.listen)
    listener = Listener(address, port, tuple(arguments.host), tuple(arguments.origin), arguments.proxy)
    check_listener(listener, access)
    link = (
        f"{listener.url}/sign-in?token={access.create_link_token()}" if listener.is_loopback else listener.url
    )

    def announce() -> None:
        """Print the address of the server."""
        once = "; the link works once, within 10 minutes" if listener.is_loopback else "; sign in with a key"
        ended = "the server and its prints" if arguments.demo else "the server, not the prints"
        print_text(arguments, f"serving at {link}{once}. Ctrl-C ends {ended}", is_message=False)
        if arguments.open:
            webbrowser.open(link)

    run_server(queue, access, listener, on_ready=announce, say=lambda text: print_text(arguments, text))
