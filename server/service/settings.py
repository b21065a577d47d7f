"""Settings of the service: of the command line, of `FINGERTWIN_…` variables, or their defaults."""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path
from typing import Annotated, Literal

from platformdirs import user_data_path
from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

DATABASE_FILE = "fingertwin.db"
# What can be removed for good: content of deleted sessions, jobs that have ended, messages of the live stream.
What = Literal["deleted", "jobs", "messages"]


def default_folder() -> Path:
    """Return the default data folder of the service."""
    return user_data_path("fingertwin", appauthor=False)


class Settings(BaseSettings):
    """Settings of the service."""

    model_config = SettingsConfigDict(env_prefix="FINGERTWIN_", extra="ignore")

    host: str = "127.0.0.1"  # address that it listens on; another than loopback needs a token
    port: int = Field(default=8765, ge=0, le=65535)  # that it listens on
    data: Path = Field(default_factory=default_folder)  # folder of its database and backups
    database_url: str | None = None  # another database than SQLite in that folder
    # Processes that refit and diagnose; 0 takes as many as half the cores, at most 4.
    workers: int = Field(default=0, ge=0, le=64)
    # Whether they start with the service and compile the models, instead of with the first job.
    warm_workers: bool = True
    # Whether what only reads is answered by a process of its own, which benches do not wait for.
    reader_process: bool = True
    job_timeout_s: float = Field(default=1800.0, gt=0)  # after which a job that says nothing else is given up
    executor: Literal["processes", "dask"] = "processes"  # of population runs: processes here, or a Dask cluster
    dask_scheduler: str | None = None  # address of the cluster's scheduler
    most_body_bytes: int = Field(default=16 << 20, ge=1 << 16)  # of a request
    # Of one client beyond loopback; bursts of ten times as many pass.
    requests_per_s: float = Field(default=100.0, gt=0)
    # How long deleted sessions, ended jobs and live messages are kept, as JSON such as `{"deleted": 30}`; what is not
    # named is kept for good.
    keep_days: dict[What, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    log_format: Literal["text", "json"] = "text"  # lines to read, or JSON
    log_level: Literal["debug", "info", "warning", "error"] = "info"  # of the log

    @property
    def url(self) -> str:
        """Address of the database."""
        return self.database_url or f"sqlite:///{self.data / DATABASE_FILE}"

    @property
    def worker_count(self) -> int:
        """Processes that refit and diagnose."""
        return self.workers or max(1, min(4, (os.cpu_count() or 2) // 2))

    @property
    def loopback(self) -> bool:
        """True if it can be reached from this machine only."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"
