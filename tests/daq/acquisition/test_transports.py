"""Ports that are there, that are not, and that go away."""

from __future__ import annotations

import os
import socket
import threading
import time

import pytest

from daq.acquisition.transports import SerialTransport, UdpTransport, connect
from daq.drivers.base import Transport
from daq.drivers.robotiq import Robotiq
from daq.errors import DriverError, LinkLostError


def read_often(link: Transport) -> None:
    for _ in range(20):
        link.read(0.05)


def test_what_came_is_read_at_once_and_silence_takes_its_time() -> None:
    # pyserial's own loop-back: what is written comes back.
    link = SerialTransport("loop://", 115200)
    link.write(b"abc")
    assert link.read(1.0) == b"abc"
    began = time.monotonic()
    assert link.read(0.05) == b""
    assert 0.04 < time.monotonic() - began < 0.5
    link.close()
    with pytest.raises(LinkLostError):
        link.read(0.05)
    link.close()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_a_port_that_is_read_already_is_refused_and_free_afterwards() -> None:
    ours, theirs = os.openpty()
    port = os.ttyname(theirs)
    link = SerialTransport(port, 115200)
    with pytest.raises(DriverError, match=f"{port} is in use; expected a free port"):
        SerialTransport(port, 115200)
    os.write(ours, b"abc")
    assert link.read(1.0) == b"abc"
    link.close()
    SerialTransport(port, 115200).close()
    os.close(ours)
    os.close(theirs)


def test_a_host_that_hangs_up_is_a_lost_link() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = SerialTransport(f"socket://127.0.0.1:{server.getsockname()[1]}", 9600)
        host, _ = server.accept()
        with host:
            host.sendall(b"hello")
            assert link.read(1.0) == b"hello"
        with pytest.raises(LinkLostError):
            read_often(link)
        link.close()


@pytest.mark.parametrize(
    ("port", "said"),
    [("no-such-port-9", "no port no-such-port-9"), (None, "robotiq-ft300 lacks a port; expected the serial port")],
)
def test_a_port_that_is_not_there_is_said_with_those_that_are(port: str | None, said: str) -> None:
    with pytest.raises(DriverError, match=said) as caught:
        connect(Robotiq(), port)
    assert "here" in str(caught.value).lower()
    assert "Errno" not in str(caught.value)


def test_datagrams_come_one_by_one() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        device.bind(("127.0.0.1", 0))
        link = UdpTransport(f"127.0.0.1:{device.getsockname()[1]}")
        link.write(b"start")
        data, host = device.recvfrom(100)
        assert data == b"start"
        device.sendto(b"one", host)
        device.sendto(b"two", host)
        assert [link.read(1.0), link.read(1.0), link.read(0.01)] == [b"one", b"two", b""]
        link.close()


def test_a_device_that_refuses_is_a_lost_link() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = UdpTransport(f"127.0.0.1:{port}")
    link.write(b"start")
    with pytest.raises(LinkLostError, match="has gone"):
        read_often(link)
    link.close()


@pytest.mark.parametrize("address", ["host:port", "no.such.host.invalid"])
def test_an_address_that_is_none_is_said(address: str) -> None:
    with pytest.raises(DriverError, match=address):
        UdpTransport(address)


def test_reading_from_one_thread_while_another_closes_ends_the_read() -> None:
    link = SerialTransport("loop://", 115200)
    timer = threading.Timer(0.1, link.close)
    timer.start()
    with pytest.raises(LinkLostError):
        read_often(link)
    timer.join()
