"""How the pages look that need no server, in light and in dark.

Figures are drawn in black on white; in the dark what is drawn so takes the page's ink.
"""

STYLE = """
:root { color-scheme: light dark; --line: #d5dae0; --soft: #66707c; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } p.lead { color: var(--soft); }
table { border-collapse: collapse; width: 100%; margin: 1rem 0; }
th, td { text-align: right; padding: .3rem .4rem; font-size: .85rem;
         border-bottom: 1px solid var(--line); }
th[title] { text-decoration: underline dotted; cursor: help; }
th:first-child, td:first-child { text-align: left; }
.alarm { border-left: 4px solid #b3382c; padding: .2rem 1rem; }
.curves { display: grid; grid-template-columns: repeat(auto-fit, minmax(17rem, 1fr));
          gap: 1rem; }
.curves figure { margin: 0; background: #fff; border: 1px solid var(--line);
                 border-radius: 8px; padding: .4rem; }
.curves svg { width: 100%; height: auto; display: block; }
.curves figcaption { color: #333; font-size: .9rem; text-align: center;
                     overflow-wrap: anywhere; }
.film img, .film svg { max-width: 100%; border-radius: 8px; } .film { margin: 1rem 0; }
dl.about { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1rem; }
dl.about dt { color: var(--soft); } dl.about dd { margin: 0; overflow-wrap: anywhere; }
code { overflow-wrap: anywhere; }
@media (prefers-color-scheme: dark) {
  :root { --line: #3a424b; --soft: #a3adb8; --ink: #e6e8ea; --card: #1c2126; }
  .curves figure { background: var(--card); } .curves figcaption { color: var(--ink); }
  .alarm { border-color: #ff8a80; }
  g[id^="figure"] text { fill: var(--ink); }
  g[id^="figure"] [style*="stroke: #000000"] { stroke: var(--ink) !important; }
  g[id^="figure"] [style*="fill: #ffffff"] { fill: transparent !important; }
  g[id^="figure"] [style*="stroke: #2563a8"] { stroke: #6cb0ff !important; }
  g[id^="figure"] [style*="fill: #2563a8"] { fill: #6cb0ff !important; }
}
code, pre { font-size: .9rem; } pre { overflow-x: auto; }
"""
