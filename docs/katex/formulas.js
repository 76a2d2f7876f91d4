// Sets every formula of a page; KaTeX is loaded only where there is one. All files are beside this one.
(() => {
  const here = document.currentScript.src.replace(/[^/]*$/, "");
  const formulas = document.querySelectorAll(".arithmatex");
  if (!formulas.length) return;
  const style = Object.assign(document.createElement("link"), { rel: "stylesheet", href: here + "katex.min.css" });
  const program = Object.assign(document.createElement("script"), { src: here + "katex.min.js" });
  program.onload = () => {
    for (const formula of formulas) {
      const [, open, tex] = formula.textContent.trim().match(/^(\\\(|\\\[)([^]*)\\[)\]]$/);
      katex.render(tex, formula, { displayMode: open === "\\[", throwOnError: false });
    }
  };
  document.head.append(style, program);
})();
