"""SIGINT and SIGTERM: shut down all contexts and end all waits."""

import os
import signal
import threading
import traceback
from enum import Enum
from typing import Any

from rclpy.context import initialized


class SignalHandlerOptions(Enum):
    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_SIGNALS = {signal.SIGINT: SignalHandlerOptions.SIGINT, signal.SIGTERM: SignalHandlerOptions.SIGTERM}
_previous: dict[int, Any] = {}
_wakeup: tuple[int, int] | None = None
_previous_wakeup_fd = -1


def _on_signal(number: int, frame: Any) -> None:
    # The shutdown itself is left to the thread below: here, the locks it takes may be held already.
    for context in initialized:
        context._interrupted = True
    previous = _previous.get(number)
    if callable(previous):
        previous(number, frame)


def _watch(fd: int) -> None:
    """Shut down all contexts; this also wakes a main thread that waits in the middleware, which no signal does."""
    while received := os.read(fd, 1):
        if received[0] in _previous:
            for context in initialized:
                try:
                    context.try_shutdown()
                except Exception:  # a callback for the shutdown; the other contexts and further signals still count
                    traceback.print_exc()
    os.close(fd)


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Install handlers, which call the former ones too. Only the main thread can do this."""
    global _wakeup, _previous_wakeup_fd
    if threading.current_thread() is not threading.main_thread():
        return
    for number, option in _SIGNALS.items():
        if options in (option, SignalHandlerOptions.ALL) and number not in _previous:
            _previous[number] = signal.signal(number, _on_signal)
    if _previous and _wakeup is None:
        _wakeup = os.pipe()
        os.set_blocking(_wakeup[1], False)
        _previous_wakeup_fd = signal.set_wakeup_fd(_wakeup[1], warn_on_full_buffer=False)
        threading.Thread(target=_watch, args=(_wakeup[0],), name="rclpy_signals", daemon=True).start()


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    return SignalHandlerOptions(sum(option.value for number, option in _SIGNALS.items() if number in _previous))


def uninstall_signal_handlers() -> None:
    """Put the former handlers back."""
    global _wakeup
    if threading.current_thread() is not threading.main_thread():
        return
    for number, previous in list(_previous.items()):
        if signal.getsignal(number) is _on_signal:
            signal.signal(number, previous)
        del _previous[number]
    if _wakeup is not None:
        signal.set_wakeup_fd(_previous_wakeup_fd)
        os.close(_wakeup[1])
        _wakeup = None
