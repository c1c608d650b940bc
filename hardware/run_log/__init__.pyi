from .protocol import NoLog as NoLog, RunLogger as RunLogger
from .reader import (
    LogEvent as LogEvent,
    RunLogRecords as RunLogRecords,
    read_run_log as read_run_log,
)
from .writer import RunLog as RunLog
