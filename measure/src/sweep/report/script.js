document.querySelectorAll("section").forEach(section => {
  const all = section.querySelectorAll("[data-row]");
  all.forEach(one => {
    const set = on => all.forEach(other => {
      if (other.dataset.row === one.dataset.row) other.classList.toggle("chosen", on);
    });
    one.addEventListener("mouseenter", () => set(true));
    one.addEventListener("mouseleave", () => set(false));
  });
});
