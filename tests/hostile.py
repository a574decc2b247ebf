"""Strings that break programs which paste names into code, markup, tables or paths: the first kind are names, the second are refused."""
from __future__ import annotations

NAMES = {
    "quote": 'a"b', "apostrophe": "a'b", "three quotes": '"""\nimport os; os.system("touch PWNED")\n"""'.replace("\n", " "),
    "three apostrophes": "'''; open('PWNED', 'w') #", "end of a literal": "x'}; __import__('os').system('touch PWNED'); {'y",
    "windows path": "C:\\Users\\cell\\new\\u0041", "backslash at the end": "cell\\", "end of a comment": "--->", "more of a comment":
    '--!><robot name="x"><link name="evil"/><!--', "end of CDATA": "]]>", "script": "</script><script>document.title='PWNED'</script>",
    "image": "<img src=x onerror=\"document.title='PWNED'\">", "entity": "&lt;&#x3c;&unknown;", "doctype":
    '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>', "jinja": "{{ 7 * 7 }}{% raw %}", "shell": "$(touch PWNED)", "dollars":
    "$title ${study} $$x^$", "backticks": "`touch PWNED`", "command": "; rm -rf x | touch PWNED && y", "percent": "%s %n %(name)s {0} {",
    "up": "../../..", "absolute": "/etc/x", "device": "CON", "formula": '=HYPERLINK("http://x","y")', "plus": "+1+cmd|' /C calc'!A0",
    "plus one": "+1", "minus": "-2+3", "minus one": "-1", "at": "@SUM(1)", "full-width": "\uff1d1+1", "apostrophe formula": "'=1+1",
    "typst": "#eval(\"1\") *a* _b_ $x$ @ref <label> #read(\"/etc/passwd\")", "markdown": "[a](javascript:alert(1)) **b** `c` # d | e",
    "svg": '<svg onload="x"/>', "toml": 'a = 1 # "b" [c]\'', "csv": 'a,b;c\t'.strip() + '"d","e"', "rich": "[bold]x[/red] [link=y]z :smile:",
    "emoji": "\U0001f916\U0001f468\u200d\U0001f469\u200d\U0001f467", "hebrew": "\u05ea\u05d0 7", "combining": "Z\u0351\u036b\u0343a\u0308\u0301lgo",
    "persian": "\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645", "nul in words": "a\\0b", "longest": "x" * 200, "no break": "a\u00a0b",
    "ligature": "\ufb01le", "keyword": "lambda", "data marker": "DATA: Data = {}", "base": "base", "link": "link2"}

REFUSED = {
    "newline": "a\nb", "carriage return": "a\rb", "tab": "a\tb", "nul": "a\0b", "bell": "a\x07b", "escape": "\x1b]0;PWNED\x07\x1b[31mred",
    "delete": "a\x7fb", "next line": "a\x85b", "line separator": "a\u2028b", "right-to-left mark": "cell \u200f7",
    "right-to-left override": "cell\u202efdp.exe", "isolate": "\u2066cell", "zero-width space": "cell\u200b1", "byte-order mark": "a\ufeffb",
    "soft hyphen": "a\u00adb", "tag": "a\U000e0041b", "surrogate": "a\ud800b", "no character": "a\uffffb", "blanks": "   ", "only marks":
    "\u0301\u0301", "joiner alone": "\u200d", "too long": "x" * 201}
