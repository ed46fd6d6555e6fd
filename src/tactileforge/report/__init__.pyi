from tactileforge.report.run import report_of_run as report_of_run
from tactileforge.report.run import write_report as write_report
