"""The address of a dask scheduler, checked before a client is made of it."""

from __future__ import annotations

from ..exceptions import StudyError

SECURE = ("tls", "wss")  # schemes that need certificates


def check_scheduler_address(address: str) -> None:
    """Refuse an address that no client can take: one that fails on it waits for its own end, and
    shows a traceback then. Raises StudyError."""
    from distributed.comm import get_address_host_port, parse_address
    from distributed.security import Security

    place = f'--scheduler "{address}"'
    try:
        get_address_host_port(address)
    except ValueError:
        raise StudyError(
            f"{place}: expected the address of a running dask scheduler, tcp://HOST:PORT."
        ) from None
    scheme, _ = parse_address(address)
    if scheme in SECURE and Security().get_connection_args("client")["ssl_context"] is None:
        raise StudyError(
            f"{place}: {scheme} needs certificates, and dask's configuration names none "
            "(distributed.comm.tls). Name them, or give tcp://HOST:PORT."
        )
