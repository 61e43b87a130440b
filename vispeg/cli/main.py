"""The command `vispeg`: find the sub-command, parse its arguments, run it, and turn errors into exit codes."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from vispeg import __version__
from vispeg.api.machine.graphics import check_backend, choose_backend
from vispeg.cli.overview import installed, overview
from vispeg.core.disk import FULL, refused, why
from vispeg.core.errors import UserError
from vispeg.core.extras import lacks, missing
from vispeg.core.interrupt import Interrupted
from vispeg.core.memory import large_apart
from vispeg.core.notes import Note, line
from vispeg.core.provenance import command_line

# Problems are small and run beside simulations, so BLAS threads would only wait for one another: a diagnosis in torque
# space took 15 times the processor time. PyTorch's threads are not affected.
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
# objects between garbage collections; with Python's 700 they take a quarter of the time of an HTML report
GARBAGE = 10_000
EXIT_USAGE, EXIT_INTERRUPT, EXIT_PIPE, EXIT_TERMINATED = 2, 130, 141, 143


def run(argv: Sequence[str]) -> int:
    """Run one command line (without the program's name). Raises UserError on bad input."""
    if len(argv) > 1 and argv[0] == "help":
        return run([*argv[1:], "--help"])
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(overview())
        return 0 if argv else EXIT_USAGE
    if argv[0] in ("-V", "--version"):
        print(f"vispeg {__version__}")
        return 0
    commands = installed()
    if argv[0] not in commands:
        raise UserError("unknown command", got=argv[0], choices=commands)
    choose_backend()
    os.environ.setdefault(BLAS_THREADS, "1")  # before NumPy is imported
    if argv[0] == "doctor":  # must work even if a library or the parser is missing
        from vispeg.cli.doctor import doctor

        return doctor(argv[1:])
    from vispeg.cli.usage import parsed

    check_backend()
    command, args = parsed(argv[0], argv[1:])
    if args.output.quiet:
        warnings.showwarning = lambda *_, **__: None
    return command.run(args)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; return the exit code.

    Exit codes: 0 done, 1 an alarm of `suite` or a fault that `doctor` found, 2 bad input or usage, no memory or a file
    that cannot be written, 130 interrupted, 141 the reader of the output went away, 143 terminated.
    """
    UserError.in_command = True
    gc.set_threshold(GARBAGE)
    large_apart()
    try:
        with warnings.catch_warnings(), _terminable() as stopped:
            # notes are output, so they are shown even if Python's warnings are off
            warnings.simplefilter("default", Note)
            warnings.showwarning = _note
            code = _main([*(sys.argv[1:] if argv is None else argv)])
    finally:
        UserError.in_command = False
    return EXIT_TERMINATED if stopped and code == EXIT_INTERRUPT else code


@contextmanager
def _terminable() -> Iterator[list[int]]:
    """Make SIGTERM, which batch systems send, end a command as Ctrl-C does; yield a list of the received signals."""
    stopped: list[int] = []
    owner = os.getpid()

    def stop(number: int, _: FrameType | None) -> None:
        if os.getpid() != owner:  # a forked helper has nothing to clean up
            os._exit(128 + number)
        stopped.append(number)
        raise KeyboardInterrupt

    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if ours:
        signal.signal(signal.SIGTERM, stop)
    try:
        yield stopped
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _main(argv: list[str]) -> int:
    try:
        code = run(argv)
        sys.stdout.flush()
        return code
    except UserError as error:
        return _refuse(error)
    except ImportError as error:
        if (module := lacks(error)) is None:
            raise
        return _refuse(missing(module, f"vispeg {argv[0]}"))
    except Interrupted as stop:
        print(f"vispeg: interrupted; to continue: {command_line(['vispeg', *stop.again(argv)])}", file=sys.stderr)
        return EXIT_INTERRUPT
    except KeyboardInterrupt:
        print(f"vispeg: interrupted; to begin again: {command_line(['vispeg', *argv])}", file=sys.stderr)
        return EXIT_INTERRUPT
    except MemoryError as error:  # NumPy's states the requested amount
        what = " ".join(str(error).split()) or "no more memory"
        print(f"vispeg: error: not enough memory: {what}", file=sys.stderr)
        return EXIT_USAGE
    except BrokenPipeError:  # `vispeg effects | head`
        _drop_output()
        return EXIT_PIPE
    except OSError as error:
        if not refused(error):
            raise
        what = f"cannot be written: {why(error)}" if error.errno in FULL else why(error)
        print(f"vispeg: error: {UserError(what, file=error.filename)}", file=sys.stderr)
        _drop_output()
        return EXIT_USAGE
    except SystemExit as stop:  # the argument parser's: 0 after --help, 2 after a usage error
        return stop.code if isinstance(stop.code, int) else EXIT_USAGE


def _drop_output() -> None:
    """Redirect standard output to /dev/null if it cannot be written, so that flushing at exit does not fail."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse(error: UserError) -> int:
    print(f"vispeg: error: {error}", file=sys.stderr)
    return EXIT_USAGE


def _note(message: Warning | str, *_: object, **__: object) -> None:
    print(line(message), file=sys.stderr)
