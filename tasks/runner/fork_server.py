"""The program that starts processes for stages: it has their modules loaded and forks a child for each job.

In: the number of a socket and the parent's process id as arguments; on the socket requests `{"module": ...}`, each a
message of its own. A request without descriptors only loads the module. One with descriptors asks for a child: a
socket for this child alone and what becomes its standard input, output and error. Out: on the child's socket its
process id or the number of the error that kept it from starting, and how it ended, each a line of JSON; whoever closes
the other end of this socket, or shuts it down for writing, kills the child.

The program has one thread of Python's and never starts Taichi: a child that is forked after that hangs. Libraries start
threads when they are loaded, OpenBLAS and the allocator of Arrow: both have handlers that stop their threads before a
fork and start new ones when they are needed. The program ends with its parent, and all children with it.
"""

import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
from contextlib import suppress
from dataclasses import dataclass

from tasks.runner import child
from tasks.runner.process_group import kill_group, reap
from tasks.runner.stage import Stage

MOST_BYTES = 4096  # of a request, which holds the name of a module
DESCRIPTORS = 4  # of a request for a child


@dataclass(frozen=True, eq=False, slots=True)
class Job:
    """A child at work."""

    pid: int
    link: socket.socket
    """Readable once nobody waits for the child any more."""
    exit_fd: int
    """Readable once the child has ended."""


class ForkServer:
    """Loads modules and forks children, for one parent."""

    def __init__(self, requests: socket.socket, parent: int) -> None:
        self.requests = requests
        self.parent_fd = os.pidfd_open(parent)
        """Readable once the parent has ended, even if a process that it forked holds its sockets open."""
        self.jobs: list[Job] = []
        self.selector = selectors.DefaultSelector()
        self.selector.register(requests, selectors.EVENT_READ)
        self.selector.register(self.parent_fd, selectors.EVENT_READ)

    def serve(self) -> bool:
        """Answer requests until the parent has gone (False); True in each child, its descriptors in place."""
        while True:
            for key, _ in self.selector.select():
                if key.data is not None:
                    self.attend(key.data, key.fd)
                elif key.fd == self.parent_fd:
                    return False
                else:
                    message, descriptors, _, _ = socket.recv_fds(self.requests, MOST_BYTES, DESCRIPTORS)
                    if not message:
                        return False
                    if self.answer(json.loads(message)["module"], descriptors):
                        return True

    def answer(self, module: str, descriptors: list[int]) -> bool:
        """Load the module, then fork if a child is asked for; True in the child."""
        load(module)
        if len(descriptors) < DESCRIPTORS:  # none, or no room for all: the parent finds the child's socket closed
            for one in descriptors:
                os.close(one)
            return False
        link = socket.socket(fileno=descriptors[0])
        if self.start_child(link) == 0:
            self.become_child(link, descriptors[1:])
            return True
        for one in descriptors[1:]:
            os.close(one)
        return False

    def start_child(self, link: socket.socket) -> int:
        """Fork, watch the child and tell its process id, or the error that kept it from starting; 0 in the child."""
        pid = -1
        try:
            pid = os.fork()
            exit_fd = os.pidfd_open(pid) if pid else -1
        except OSError as error:
            if pid > 0:
                kill(pid)
                reap(pid)
            tell(link, errno=error.errno)
            link.close()
            return -1
        if pid:
            self.watch(Job(pid, link, exit_fd))
            tell(link, pid=pid)
        return pid

    def become_child(self, link: socket.socket, standard: list[int]) -> None:
        """Lead a session, keep nothing of the server's, and have the standard descriptors that were sent."""
        os.setsid()
        self.selector.close()
        for one in (self.requests, link, *(job.link for job in self.jobs)):
            one.close()
        for descriptor in (self.parent_fd, *(job.exit_fd for job in self.jobs)):
            os.close(descriptor)
        for number, descriptor in enumerate(standard):
            os.dup2(descriptor, number)
            os.close(descriptor)

    def watch(self, job: Job) -> None:
        """Notice the end of a child, and that nobody waits for it any more."""
        self.jobs.append(job)
        self.selector.register(job.link, selectors.EVENT_READ, job)
        self.selector.register(job.exit_fd, selectors.EVENT_READ, job)

    def attend(self, job: Job, readable: int) -> None:
        """Report a child that has ended; kill one that nobody waits for."""
        if job not in self.jobs:  # both at once, and the other came first
            return
        if readable != job.exit_fd:
            self.selector.unregister(job.link)
            kill(job.pid)
            return
        if job.link in self.selector.get_map():
            self.selector.unregister(job.link)
        self.selector.unregister(job.exit_fd)
        self.jobs.remove(job)
        tell(job.link, status=reap(job.pid))
        job.link.close()
        os.close(job.exit_fd)


def load(module: str) -> None:
    """Load a module for all children to come, and what its stages load only when they run; what cannot be loaded is
    left to the child, which says why."""
    if module in sys.modules:
        return
    with suppress(Exception):
        for one in list(vars(importlib.import_module(module)).values()):
            for name in one.loads if isinstance(one, Stage) else ():
                importlib.import_module(name)
    gc.collect()
    gc.freeze()  # a collection in a child would write into each object, and so copy every page that is shared


def tell(link: socket.socket, **message: object) -> None:
    """A line of JSON, if somebody still listens."""
    with suppress(OSError):
        link.sendall(json.dumps(message).encode() + b"\n")


def kill(pid: int) -> None:
    """Kill a child and everything that it started."""
    kill_group(pid)
    os.kill(pid, signal.SIGKILL)  # it may not lead its group yet; nobody else reaps it, so the number is its own


def main() -> None:
    """Serve; in each child, run the stage as a process that was started for it alone would."""
    number, parent = (int(one) for one in sys.argv[1:])
    server = ForkServer(socket.socket(fileno=number), parent)
    own = os.getpid()
    if server.serve():
        sys.argv = [str(child.__file__), str(own)]
        child.main()
        return
    for job in server.jobs:
        kill(job.pid)
    os._exit(0)


if __name__ == "__main__":
    main()
