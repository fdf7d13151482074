<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: mean of the canopy height model, from the lowest area (pale) to the highest (dark green). -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips|Rendering">
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="173,221,142,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="70,70,70,90"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.2"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
     <data_defined_properties>
      <Option type="Map">
       <Option name="name" type="QString" value=""/>
       <Option name="properties" type="Map">
        <Option name="fillColor" type="Map">
         <Option name="active" type="bool" value="true"/>
         <Option name="expression" type="QString" value="coalesce(ramp_color(create_ramp(map(0, '#f7fcb9', 0.5, '#78c679', 1, '#004529')), if(maximum(&quot;top_height_m&quot;) &gt; minimum(&quot;top_height_m&quot;), (&quot;top_height_m&quot; - minimum(&quot;top_height_m&quot;)) / (maximum(&quot;top_height_m&quot;) - minimum(&quot;top_height_m&quot;)), 0.5)), '#d9d9d9')"/>
         <Option name="type" type="int" value="3"/>
        </Option>
       </Option>
       <Option name="type" type="QString" value="collection"/>
      </Option>
     </data_defined_properties>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <layerOpacity>0.85</layerOpacity>
 <mapTip enabled="1">&lt;b&gt;[% "id" %]&lt;/b&gt;: [% coalesce(format_number("top_height_m", 2), '?') %] m on average, 95 % of returns from plants below [% coalesce(format_number("p95_m", 2), '?') %] m&lt;br&gt;gaps [% coalesce(format_number(100 * "gap_fraction", 1), '?') %] %, [% coalesce(format_number("returns_m2", 1), '0') %] returns/m²</mapTip>
</qgis>
