// Values under the pointer in a plot: read from the drawn curves, by the scales in the plot's data.
(() => {
  for (const figure of document.querySelectorAll('figure[data-axes]')) {
    const svg = figure.querySelector('svg');
    const tip = figure.querySelector('.tip');
    if (!svg || !tip) continue;
    const all = JSON.parse(figure.dataset.axes);
    const pointsOf = new Map();
    const points = (id) => {
      if (!pointsOf.has(id)) {
        const path = svg.getElementById ? svg.getElementById(id)?.querySelector('path') : null;
        const numbers = (path?.getAttribute('d') ?? '').match(/-?[\d.]+(?:e-?\d+)?/g) ?? [];
        const list = [];
        for (let i = 0; i + 1 < numbers.length; i += 2) list.push([+numbers[i], +numbers[i + 1]]);
        pointsOf.set(id, list);
      }
      return pointsOf.get(id);
    };
    svg.addEventListener('pointermove', (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const axes = all.find((a) => at.x >= a.box[0] && at.x <= a.box[2] && at.y >= a.box[1] && at.y <= a.box[3]);
      tip.hidden = !axes;
      if (!axes) return;
      const [x0, y0, x1, y1] = axes.box;
      const time = axes.x[0] + ((at.x - x0) / (x1 - x0)) * (axes.x[1] - axes.x[0]);
      const lines = [`t = ${time.toFixed(2)} s`];
      for (const curve of axes.curves) {
        const list = points(curve.id);
        let best = null;
        for (let i = 1; i < list.length; i++) {
          const [a, b] = [list[i - 1], list[i]];
          if ((a[0] - at.x) * (b[0] - at.x) > 0) continue;
          const s = b[0] === a[0] ? 0 : (at.x - a[0]) / (b[0] - a[0]);
          best = a[1] + s * (b[1] - a[1]);
        }
        if (best === null) continue;
        const part = (y1 - best) / (y1 - y0);
        const value = axes.log
          ? axes.y[0] * (axes.y[1] / axes.y[0]) ** part
          : axes.y[0] + part * (axes.y[1] - axes.y[0]);
        lines.push(`${curve.name}: ${Number(value.toPrecision(3)).toLocaleString('en', { maximumSignificantDigits: 3, notation: Math.abs(value) < 1e-3 ? 'scientific' : 'standard' })}`);
      }
      tip.textContent = lines.join('\n');
      const box = figure.getBoundingClientRect();
      const left = event.clientX - box.left;
      tip.style.left = `${left > box.width / 2 ? left - tip.offsetWidth - 14 : left + 14}px`;
      tip.style.top = `${event.clientY - box.top + 12}px`;
    });
    svg.addEventListener('pointerleave', () => (tip.hidden = true));
  }
})();
