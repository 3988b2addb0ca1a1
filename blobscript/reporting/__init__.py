"""Reports: error against run time of one scene, against certified hits.

rays -> reference            seeded rays, and a proof of what each one hits
searches normals indexes     what is measured (judging, timing)
meshes sampling
content                      a whole report as data
summary tables figures       what follows from it
sections -> page, markdown   in reading order, as HTML or Markdown; as_json has all figures
"""

from blobscript.reporting.as_json import report_json
from blobscript.reporting.content import Report, make_report
from blobscript.reporting.markdown import markdown
from blobscript.reporting.page import page

__all__ = ["Report", "make_report", "markdown", "page", "report_json"]
