"""How dangerous it was, as a page or a section of one: risk, criticality, marked scenes, verdicts."""

from resim.report.assessment.page import section, write_assessment_page

__all__ = ["section", "write_assessment_page"]
