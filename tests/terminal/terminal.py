"""A terminal without anybody before it: runs a command in a pseudo-terminal and keeps what would be seen.

Takes the command as its arguments and orders in JSON, a line each, on standard input; answers each with a line of JSON.
It knows as much of a terminal as the feeder uses: placing the cursor, clearing, the other screen, and the cursor's
visibility.
"""

import codecs
import fcntl
import json
import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

CONTROL = re.compile(r"\x1b\[([?>=]?)([0-9;]*)([A-Za-z])|\x1b[()][A-Z0-9]|\x1b[=>78]")


class Screen:
    """Cells, and where the next character goes."""

    def __init__(self, columns, rows):
        self.columns, self.rows = columns, rows
        self.cells = [[" "] * columns for _ in range(rows)]
        self.row = self.column = 0
        self.is_other = False
        self.has_cursor = True
        self.has_colours = False
        self.left = ""
        # Everything written to the first screen.
        self.first = ""

    def text(self):
        return "\n".join("".join(row).rstrip() for row in self.cells)

    def clear(self):
        self.cells = [[" "] * self.columns for _ in range(self.rows)]

    def resize(self, columns, rows):
        self.columns, self.rows = columns, rows
        self.clear()

    def feed(self, text):
        text = self.left + text
        self.left = ""
        at = 0
        while at < len(text):
            if text[at] == "\x1b":
                found = CONTROL.match(text, at)
                if found is None:
                    # The rest of it is still to come.
                    self.left = text[at:]
                    return
                self.control(found)
                at = found.end()
                continue
            self.put(text[at])
            at += 1

    def put(self, character):
        if not self.is_other:
            self.first += character
        if character == "\r":
            self.column = 0
        elif character == "\n":
            self.row = min(self.row + 1, self.rows - 1)
        elif character == "\b":
            self.column = max(self.column - 1, 0)
        elif character >= " ":
            if self.row < self.rows and self.column < self.columns:
                self.cells[self.row][self.column] = character
            self.column += 1

    def control(self, found):
        private, numbers, letter = found.group(1), found.group(2), found.group(3)
        first = [int(number) if number else 0 for number in (numbers or "").split(";")]
        if letter in ("H", "f"):
            self.row = max(first[0], 1) - 1
            self.column = max(first[1] if len(first) > 1 else 1, 1) - 1
        elif letter == "J" and first[0] in (2, 3):
            self.clear()
        elif letter in ("h", "l") and private == "?":
            if 1049 in first:
                self.is_other = letter == "h"
                self.clear()
            if 25 in first:
                self.has_cursor = letter == "h"
        elif letter == "m":
            self.has_colours |= any(30 <= number <= 48 and number != 39 or number >= 90 for number in first)
        elif letter == "C":
            self.column += max(first[0], 1)
        elif letter == "G":
            self.column = max(first[0], 1) - 1


class Terminal:
    """A pseudo-terminal with a command."""

    def __init__(self, command, patience_s):
        self.patience_s = patience_s
        self.ours, theirs = os.openpty()
        # Kept open, so that what was written last can be read after the end.
        self.theirs = theirs
        self.screen = Screen(80, 24)
        self.size(80, 24)
        self.before = termios.tcgetattr(theirs)
        self.decoder = codecs.getincrementaldecoder("utf-8")("replace")

        def lead():
            os.setsid()
            fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

        self.child = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=lead)
        self.status = None

    def size(self, columns, rows):
        fcntl.ioctl(self.theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.screen.resize(columns, rows)

    def read(self, patience_s):
        while select.select([self.ours], [], [], patience_s)[0]:
            self.screen.feed(self.decoder.decode(os.read(self.ours, 65536)))
            patience_s = 0

    def wait(self, what, found):
        give_up = time.monotonic() + self.patience_s
        while True:
            self.read(0.02)
            value = found()
            if value:
                return value
            if time.monotonic() > give_up:
                raise TimeoutError(f"waited in vain for {what}; is seen:\n{self.screen.text()}\nwas: {self.screen.first}")

    def look(self):
        now = termios.tcgetattr(self.theirs)
        return {
            "first": self.screen.first,
            "is_other_screen": self.screen.is_other,
            "has_cursor": self.screen.has_cursor,
            "has_colours": self.screen.has_colours,
            "id": self.child.pid,
            "is_as_before": now == self.before,
        }

    def has_ended(self):
        self.status = self.child.poll()
        return self.status is not None

    def obey(self, order):
        do = order["do"]
        if do == "until":
            pattern = re.compile(order["pattern"])
            return self.wait(order["pattern"], lambda: pattern.search(self.screen.text())).groups()
        if do == "keys":
            os.write(self.ours, order["keys"].encode())
            return None
        if do == "size":
            self.size(order["columns"], order["rows"])
            return None
        if do == "signal":
            os.kill(self.child.pid, getattr(signal, order["signal"]))
            return None
        if do == "ended":
            self.wait("the end", self.has_ended)
            # What it wrote last lies in the terminal already.
            self.read(0)
            return {"status": self.status, **self.look()}
        if do == "look":
            self.read(0)
            return self.look()
        raise ValueError(f"no such order: {do}")

    def close(self):
        if self.status is None:
            # The session's leader: its nodes see it go and end.
            self.child.kill()
            self.child.wait()


def main():
    terminal = Terminal(sys.argv[2:], float(sys.argv[1]))
    try:
        for line in sys.stdin:
            try:
                answer = {"value": terminal.obey(json.loads(line))}
            except Exception as error:
                answer = {"error": str(error)}
            print(json.dumps(answer), flush=True)
    finally:
        terminal.close()


main()
