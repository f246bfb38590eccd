"""The style of a self-contained page; it also prints."""

#: System fonts and few colours; what a colour says stands in the table as a word too.
STYLE = """
body { font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; color: #222; max-width: 68rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.25; }
h2 { font-size: 1.25rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; padding-bottom: .2rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .4rem; }
p.small, p.caption { font-size: .875rem; color: #444; }
li { margin: .3rem 0; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .8125rem; margin: .5rem 0 1rem; }
th, td { padding: .25rem .6rem; text-align: left; border-bottom: 1px solid #e3e3e3; vertical-align: top; }
th { border-bottom: 1px solid #777; font-weight: 600; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.likely td { background: #eaf5f0; }
tr.at-worst td { background: #f6f8e8; }
tr.nominal-sizes td { background: #fdf3e0; }
tr.no td { background: #fbe9e2; }
figure { margin: 1.2rem 0 1.8rem; text-align: center; }
figure img { max-width: 100%; height: auto; }
p.caption { text-align: left; margin: .3rem auto; max-width: 48rem; }
@media print {
  body { font-size: 10pt; max-width: none; margin: 0; }
  table { font-size: 8pt; }
  tr, figure { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  td { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
