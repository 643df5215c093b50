"use strict";
(() => {
  // Rows drawn at first, and further ones whenever the end of a list comes into view.
  const FIRST = 8, STEP = 50;
  const words = new Intl.Collator("en", { numeric: true, sensitivity: "base" });
  const count = (number) => number.toLocaleString("en");

  const make = (tag, look, text) => {
    const node = document.createElement(tag);
    if (look) node.className = look;
    node.textContent = text;
    return node;
  };
  const compare = (a, b, way) => {
    if (a === null || b === null) return (a === null) - (b === null); // empty cells last, both ways
    return way * (typeof a === "number" ? a - b : words.compare(a, b));
  };

  // Sort the entries when a header is selected.
  const makeSortable = (heads, entries, show) => heads.forEach((head, column) => {
    head.querySelector("button").addEventListener("click", () => {
      const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      heads.forEach((other) => other.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      entries.sort((a, b) => compare(a.values[column], b.values[column], way) || a.order - b.order);
      show();
    });
  });

  const value = (cell) => {
    if (!cell.hasAttribute("data-v")) return cell.textContent;
    return cell.dataset.v === "" ? null : Number(cell.dataset.v);
  };
  const makeTable = (table) => {
    const body = table.tBodies[0];
    const entries = [...body.rows].map((row, order) => ({ row, order, values: [...row.cells].map(value) }));
    const show = () => body.append(...entries.map((entry) => entry.row));
    makeSortable([...table.tHead.rows[0].cells], entries, show);
  };

  // Return a function that shows entries in an element, of which the button draws the rest.
  const makeList = (target, more, draw, report = () => {}) => {
    let entries = [], drawn = 0;
    const extend = (number) => {
      const next = entries.slice(drawn, drawn + number);
      target.append(...next.map((entry) => (entry.node ??= draw(entry))));
      drawn += next.length;
      more.hidden = drawn === entries.length;
      more.textContent = `Show all ${count(entries.length)}`;
      observer.unobserve(more); // observed again, because it may still be in view
      observer.observe(more);
      report(drawn);
    };
    const observer = new IntersectionObserver((seen) => {
      if (seen.at(-1).isIntersecting) extend(STEP);
    });
    more.addEventListener("click", () => extend(Infinity));
    return (selected) => {
      entries = selected;
      drawn = 0;
      target.replaceChildren();
      extend(FIRST);
    };
  };

  const LOOKS = { "✓": "good", "○": "open", "✗": "bad" };
  const makeAnswers = (section, { columns, rows, instances }) => {
    section.append(document.getElementById("answers-of-problem").content.cloneNode(true));
    const [status, box, list] = ["[data-shown]", ".tall", ".instances"].map((name) => section.querySelector(name));
    box.setAttribute("aria-label", `Answers on ${section.dataset.problem}`);
    const table = box.firstChild;
    const heads = columns.map(([name, look]) => {
      const head = make("th", look === "n" ? look : "", "");
      head.scope = "col";
      head.setAttribute("aria-sort", "none");
      head.append(make("button", "", name));
      head.firstChild.type = "button";
      return head;
    });
    table.tHead.rows[0].append(...heads);
    const entries = rows.map((row, order) => {
      const texts = columns.map((_, i) => (Array.isArray(row[i]) ? row[i][1] : row[i]));
      const values = columns.map((_, i) => (Array.isArray(row[i]) ? row[i][0] : row[i]));
      return { order, texts, values, text: texts.join(" ").toLowerCase(), backend: row.at(-1), ended: row[2] };
    });
    const showRows = makeList(table.tBodies[0], box.lastChild, ({ texts }) => {
      const row = document.createElement("tr");
      row.append(...columns.map(([, look], i) => make("td", look === "sign" ? LOOKS[texts[i][0]] : look, texts[i])));
      return row;
    }, (drawn) => {
      status.textContent = `${count(drawn)} of ${count(rows.length)} rows shown`;
      status.toggleAttribute("data-partial", drawn < rows.length);
    });
    const showInstances = makeList(list, section.lastElementChild, ({ instance: [name, word, look, sign, html] }) => {
      const node = make("details", "", "");
      node.dataset.instance = name;
      node.append(make("summary", "", `${name} `));
      node.firstChild.append(make("span", look, `${sign} ${word}`));
      node.addEventListener("toggle", () => {
        node.insertAdjacentHTML("beforeend", html); // escaped when the page was written
        node.querySelectorAll("table.plain").forEach(makeTable);
      }, { once: true });
      return node;
    });
    const details = instances.map((instance) => ({ instance }));
    let keep = () => true;
    const show = () => {
      const matching = entries.filter(keep);
      showRows(matching);
      return matching;
    };
    makeSortable(heads, entries, show);
    return (condition) => {
      keep = condition;
      const matching = show();
      const named = new Set(matching.map((entry) => entry.values[0]));
      showInstances(details.filter(({ instance }) => named.has(instance[0])));
      return matching.length;
    };
  };

  document.querySelectorAll("table.plain").forEach(makeTable);
  const data = JSON.parse(document.getElementById("data").textContent);
  const problems = [...document.querySelectorAll("[data-problem]")].map((section, i) => ({
    section,
    filter: makeAnswers(section, data[i]),
  }));
  const form = document.querySelector("form.filters");
  form.hidden = false;
  const output = form.querySelector("[data-count]");
  const total = output.textContent;
  const filter = () => {
    const text = form.elements.text.value.trim().toLowerCase();
    const [problem, backend, ended] = ["problem", "backend", "ended"].map((name) => form.elements[name].value);
    let matches = 0;
    for (const { section, filter: select } of problems) {
      const visible = !problem || section.dataset.problem === problem;
      section.hidden = !visible;
      matches += select((row) => visible && row.text.includes(text)
        && (!backend || row.backend === backend) && (!ended || row.ended === ended));
    }
    output.textContent = `${count(matches)} of ${total} match`;
  };
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(filter));
  filter();
})();
